"""The page: start, bytes, frames, processor, memory, and the time of a stop.

Charts show a 1 kHz stream of a sweep. Needs Chromium. Another load on the machine shows in every
number, so this is wall time.
"""

from __future__ import annotations

import json
import re
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
from playwright.sync_api import Page, sync_playwright

from tests.browser.conftest import CHROMIUM, Web, connect, go_to, serving
from tests.browser.device import Device, served_device
from tests.proof.benchmarks.rows import Row

WATCH = """() => {
  window.arrivals = [];
  const socket = new WebSocket(`ws://${location.host}/stream`);
  socket.binaryType = "arraybuffer";
  socket.onmessage = () => window.arrivals.push(performance.now());
  window.presses = [];
  window.addEventListener("pointerdown", (event) =>
    window.presses.push((performance.timeOrigin + event.timeStamp) / 1000), true);
}"""


def start(page: Page, web: Web, begun_s: float) -> Iterator[Row]:
    """Open the page and yield its bytes and the time until it is usable."""
    session = page.context.new_cdp_session(page)
    session.send("Network.enable")
    sizes: list[float] = []
    session.on("Network.loadingFinished", lambda event: sizes.append(event["encodedDataLength"]))
    page.goto(web.url)
    page.get_by_text(re.compile("^(this page controls|in control)$")).wait_for()
    usable_s = time.time() - begun_s
    page.wait_for_load_state("networkidle")
    session.detach()
    yield Row("page, benchtool web to usable", usable_s, "s", wanted=2.5)
    yield Row("page, first load", sum(sizes) / 1e6, "MB", wanted=3.0)
    used_s = sum(psutil.Process(web.process.pid).cpu_times()[:2])
    yield Row("page, processor time of the server until then", used_s, "s")


def heap_MB(page: Page) -> float:
    """Return the page's heap after a collection of garbage."""
    session = page.context.new_cdp_session(page)
    session.send("HeapProfiler.collectGarbage")
    used = session.send("Runtime.getHeapUsage")["usedSize"]
    session.detach()
    return float(used) / 1e6


def stream(page: Page, web: Web, device: Device, seconds: float) -> Iterator[Row]:
    """Sweep at 1 kHz while the charts play, and yield what that takes."""
    connect(page, device.address)
    go_to(page, "Sweep")
    # Five repeats last about 12 min.
    page.get_by_label("Repeats").fill(str(5 + int(seconds / 120.0)))
    page.get_by_role("button", name="Start the sweep").click()
    page.get_by_role("button", name="Start", exact=True).click()
    page.get_by_text("running: ").wait_for()
    go_to(page, "Bench")
    page.wait_for_timeout(5000)
    server = psutil.Process(web.process.pid)
    desk = next(child for child in server.children() if "spawn_main" in " ".join(child.cmdline()))
    before_MB = heap_MB(page)
    used = [sum(process.cpu_times()[:2]) for process in (server, desk)]
    page.evaluate(WATCH)
    begun = time.monotonic()
    while time.monotonic() - begun < seconds:
        page.wait_for_timeout(1000)
        for line in next(web.runs.glob("*/events.jsonl")).read_text("utf-8").splitlines():
            event = json.loads(line)
            if event["event"] in ("ended", "stopped"):
                raise RuntimeError(f"the sweep {event['text']}")
    passed = time.monotonic() - begun
    arrivals = np.array(page.evaluate("window.arrivals.splice(0)")) / 1000.0
    shares = [
        100.0 * (sum(process.cpu_times()[:2]) - was) / passed
        for process, was in zip((server, desk), used, strict=True)
    ]
    gaps_ms = 1000.0 * np.diff(arrivals)
    yield Row("page, frames of a 1 kHz stream", len(arrivals) / passed, "frames/s", wanted=19.0)
    yield Row("page, longest gap between frames", float(gaps_ms.max()), "ms", wanted=150.0)
    memory_MB = server.memory_info().rss / 1e6
    yield Row("page, server", shares[0], "% of a core", wanted=15.0, memory_MB=memory_MB)
    yield Row("page, bench process", shares[1], "% of a core")
    work = "page, heap"
    yield Row(work, heap_MB(page), "MB", before_MB, f"{passed:.0f} s before")


def presses(page: Page, device: Device, count: int) -> Iterator[Row]:
    """Press Stop again and again, the first time in mid-sweep, and yield how long it took."""
    box = page.locator(".stop-button").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 40.0, box["y"] + 20.0)
    for _ in range(count):
        page.mouse.down()
        page.wait_for_timeout(60)
        page.mouse.up()
        page.wait_for_timeout(90)
    page.wait_for_timeout(1000)
    stops = np.array([at for at, word, _ in device.orders if word == "stop"])
    times_ms = []
    for pressed in page.evaluate("window.presses"):
        later = stops[stops >= pressed - 0.001]
        times_ms.append(1000.0 * (later[0] - pressed) if len(later) else np.inf)
    work = f"STOP, pointer down to the line at the device, {count} times"
    yield Row(f"{work}, median", float(np.median(times_ms)), "ms", wanted=10.0)
    yield Row(f"{work}, longest", float(max(times_ms)), "ms", wanted=50.0)


def rows(quick: bool) -> Iterator[Row]:
    """Yield the start, a stream and stops; every sample must be in the log."""
    if CHROMIUM is None:
        return
    with (
        tempfile.TemporaryDirectory() as folder,
        sync_playwright() as tool,
        served_device(rate_Hz=100.0 if quick else 1000.0) as device,
    ):
        browser = tool.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.set_default_timeout(60_000)
        runs = Path(folder) / "runs"
        begun_s = time.time()
        with serving(runs, Path(folder) / "state") as web:
            yield from start(page, web, begun_s)
            yield from stream(page, web, device, 2.0 if quick else 60.0)
            yield from presses(page, device, 3 if quick else 100)
            page.get_by_role("tab", name="Sweep").click()
            page.get_by_text("stopped: ").first.wait_for()
            browser.close()
        check_log(runs)


def check_log(runs: Path) -> None:
    """Raise where the run's log lacks samples, by the link's count or the device's own time."""
    from benchtool.data.run.read import read_samples
    from benchtool.data.run.run import Run

    (path,) = runs.iterdir()
    link = Run.open(path).metadata["link"]
    steps_us = np.diff(read_samples(path).column("device_time_us"))
    gaps = int((steps_us > 1.5 * np.median(steps_us)).sum())
    assert (link["lost"], link["corrupt"], gaps) == (0, 0, 0), link
