"""Print how quick the page is: start, frames, processor, memory, and how long Stop takes.

The aims: usable 2 s after `benchtool web`; over 60 s of a 1 kHz stream 19 frames a second with no
gap above 150 ms, no sample lost in the run's log and at most 15 % of a core for the server; from
pointer-down to the stop line at the device 10 ms at the median and 50 ms at the worst of 100; over
30 minutes 5 MB more for the server and 2 MB for the page's heap (`--seconds 1800`).

Needs Chromium. Another load on the machine shows in every number.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
from playwright.sync_api import Browser, Page, sync_playwright

sys.path.insert(0, str(Path(__file__).parents[3]))

from tests.browser.conftest import CHROMIUM, Web, connect, go_to, serving
from tests.browser.device import Device, served_device

PRESSES = 100

WATCH = """() => {
  window.arrivals = [];
  const socket = new WebSocket(`ws://${location.host}/stream`);
  socket.binaryType = "arraybuffer";
  socket.onmessage = () => window.arrivals.push(performance.now());
  window.presses = [];
  window.addEventListener("pointerdown", (event) =>
    window.presses.push((performance.timeOrigin + event.timeStamp) / 1000), true);
}"""


def start(browser: Browser, web: Web, begun: float) -> Page:
    """Open the page and print how long each part of it took until it was usable."""
    listens = time.time()
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    page.set_default_timeout(60_000)
    asks = time.time()
    page.goto(web.url)
    loaded = time.time()
    page.get_by_text("in control", exact=True).wait_for()
    usable = time.time()
    steps = np.diff([begun, listens, asks, loaded, usable])
    print(
        f"from benchtool web to the usable page {usable - begun:.2f} s (aim 2): to its address "
        f"{steps[0]:.2f}, window {steps[1]:.2f}, to its load event {steps[2]:.2f}, to the controls "
        f"{steps[3]:.2f}"
    )
    used_s = sum(psutil.Process(web.process.pid).cpu_times()[:2])
    print(f"processor time of the server until then {used_s:.2f} s")
    return page


def heap_MB(page: Page) -> float:
    """Return the page's heap after a collection of garbage."""
    session = page.context.new_cdp_session(page)
    session.send("HeapProfiler.collectGarbage")
    used = session.send("Runtime.getHeapUsage")["usedSize"]
    session.detach()
    return float(used) / 1e6


def stream(page: Page, web: Web, device: Device, seconds: float) -> None:
    """Sweep at 1 kHz while the charts play, and print what that took."""
    connect(page, device.address)
    go_to(page, "Sweep")
    # Five repeats last about 12 min.
    page.get_by_label("Repeats").fill(str(5 + int(seconds / 120.0)))
    page.get_by_text("limits hold").wait_for()
    page.get_by_role("button", name="Start the sweep").click()
    page.get_by_role("button", name="Start", exact=True).click()
    page.get_by_text("running: ").wait_for()
    go_to(page, "Bench")
    page.wait_for_timeout(5000)
    server = psutil.Process(web.process.pid)
    desk = next(child for child in server.children() if "spawn_main" in " ".join(child.cmdline()))
    before = server.memory_info().rss, heap_MB(page)
    used = [sum(process.cpu_times()[:2]) for process in (server, desk)]
    page.evaluate(WATCH)
    begun = time.monotonic()
    while time.monotonic() - begun < seconds:
        page.wait_for_timeout(1000)
        for line in next(web.runs.glob("*/events.jsonl")).read_text("utf-8").splitlines():
            event = json.loads(line)
            if event["event"] in ("ended", "stopped"):
                sys.exit(f"after {time.monotonic() - begun:.0f} s the sweep {event['text']}")
    passed = time.monotonic() - begun
    arrivals = np.array(page.evaluate("window.arrivals.splice(0)")) / 1000.0
    shares = [
        100.0 * (sum(process.cpu_times()[:2]) - was) / passed
        for process, was in zip((server, desk), used, strict=True)
    ]
    after = server.memory_info().rss, heap_MB(page)
    gaps_ms = 1000.0 * np.diff(arrivals)
    print(
        f"{passed:.0f} s of {device.rate_Hz:.0f} Hz: {len(arrivals) / passed:.1f} frames/s "
        f"(aim 19), worst gap {gaps_ms.max():.0f} ms (aim 150), median {np.median(gaps_ms):.0f} ms"
    )
    print(f"server {shares[0]:.1f} % of a core (aim 15), bench process {shares[1]:.1f} %")
    print(
        f"grown in {passed:.0f} s: server {(after[0] - before[0]) / 1e6:+.1f} MB, page's heap "
        f"{after[1] - before[1]:+.2f} MB (aims 5 and 2 in 30 min)"
    )


def presses(page: Page, device: Device) -> None:
    """Press Stop again and again, the first time in mid-sweep, and print how long it took."""
    box = page.locator(".stop-button").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 40.0, box["y"] + 20.0)
    for _ in range(PRESSES):
        page.mouse.down()
        page.wait_for_timeout(60)
        page.mouse.up()
        page.wait_for_timeout(90)
    page.wait_for_timeout(1000)
    stops = np.array([at for at, word, _ in device.orders if word == "stop"])
    taken_ms = []
    for pressed in page.evaluate("window.presses"):
        later = stops[stops >= pressed - 0.001]
        taken_ms.append(1000.0 * (later[0] - pressed) if len(later) else np.inf)
    print(
        f"Stop, pointer down to the line at the device, {len(taken_ms)} times: median "
        f"{np.median(taken_ms):.1f} ms (aim 10), worst {max(taken_ms):.1f} ms (aim 50)"
    )


def main() -> None:
    """Print everything."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--seconds", type=float, default=20.0)
    words.add_argument("--rate", type=float, default=1000.0)
    given = words.parse_args()
    if CHROMIUM is None:
        print("no browser is installed; on Debian or Ubuntu: apt install chromium")
        return
    print(f"load of the machine before: {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with (
        tempfile.TemporaryDirectory() as folder,
        sync_playwright() as tool,
        served_device(rate_Hz=given.rate) as device,
    ):
        browser = tool.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        runs = Path(folder) / "runs"
        begun = time.time()
        with serving(runs, Path(folder) / "state") as web:
            page = start(browser, web, begun)
            stream(page, web, device, given.seconds)
            presses(page, device)
            page.get_by_role("tab", name="Sweep").click()
            page.get_by_text("stopped: ").first.wait_for()
            browser.close()
        lost(runs)


def lost(runs: Path) -> None:
    """Print what the run's log lacks, by the device's own time."""
    from benchtool.data.run.read import read_samples
    from benchtool.data.run.run import Run

    (path,) = runs.iterdir()
    link = Run.open(path).metadata["link"]
    samples = read_samples(path)
    channels = len(samples.channels) - 4
    steps_us = np.diff(samples.column("device_time_us"))
    gaps = int((steps_us > 1.5 * np.median(steps_us)).sum())
    print(
        f"log: {link['samples']} samples of {channels} channels, {link['lost']} lost, "
        f"{link['corrupt']} corrupt, {gaps} gaps in the device's time (aim 0)"
    )


if __name__ == "__main__":
    main()
