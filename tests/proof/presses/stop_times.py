"""Times from STOP, or from what a watch must notice, to zero at the device: table of safety.md.

    python -m tests.proof.presses.stop_times --count 50 --table build/stop-times.md

Each trial turns the motors of a virtual bench from a page, brings about one situation, presses STOP
(or runs `benchtool stop`) and reads the device's own pulse. An interrupted count resumes.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import psutil

from tests.browser.conftest import CHROMIUM, TIMEOUT_MS, centre, connect, go_to, serving, start
from tests.browser.device import served_device
from tests.browser.test_bench_page import hold
from tests.browser.test_page_watch import BLOCK, hanging
from tests.long_count import LongCount

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

KINDS = ("hand throttle", "sweep", "recording")
BLOCKED_MS = 3500
LOADING_PAGES = 8
ZERO_TIMEOUT_S = 15.0
ROUND = 5  # trials of every cell before the next are begun
FIRST_PRESS_S = 0.3  # after the situation has begun
ENDED = re.compile(r" (stopped|ended)")


class Scene:
    """Server, browser, page and device in which one run turns motors."""

    def __init__(self, kind: str, folder: Path, stack: ExitStack) -> None:
        from playwright.sync_api import sync_playwright

        self.kind = kind
        self.state = folder / "state"
        self.web = stack.enter_context(serving(folder / "runs", self.state))
        mode = "pitch" if kind == "recording" else "plate"
        rig = "beam" if kind == "recording" else "pquad"
        self.device = stack.enter_context(served_device(rig, mode=mode))
        tool = stack.enter_context(sync_playwright())
        self.browser: Browser = tool.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        stack.callback(self.browser.close)
        self.page: Page = self.browser.new_page(viewport={"width": 1280, "height": 900})
        self.page.set_default_timeout(TIMEOUT_MS)
        self.page.goto(self.web.url)
        self.page.get_by_text("this page controls", exact=True).wait_for()
        connect(self.page, self.device.address, rig)
        self.stop = centre(self.page.locator(".stop-button"))

    def turn(self) -> None:
        """Turn motors, by hand or by a run that is started on the page."""
        page = self.page
        if self.kind == "hand throttle":
            hold(page, self.device)
            return
        if self.kind == "sweep":
            start(page, 9, "1")
            turning_us = 1500.0
        else:
            page.get_by_label("Duration, s").fill("600")
            page.get_by_role("button", name="Record", exact=True).last.click()
            page.get_by_role("button", name="Start", exact=True).click()
            turning_us = 1101.0
        deadline_s = time.monotonic() + 30.0
        while self.device.turning_us() < turning_us:
            assert time.monotonic() < deadline_s, self.device.orders[-5:]
            page.wait_for_timeout(20)
        page.wait_for_timeout(300)

    def press(self) -> float:
        """Press STOP with a key: the mouse may hold the throttle."""
        pressed = time.time()
        self.page.keyboard.down("Escape")
        return pressed


@contextmanager
def idle(scene: Scene) -> Iterator[float | None]:
    yield None


@contextmanager
def blocked(scene: Scene) -> Iterator[float | None]:
    scene.page.evaluate("() => { window.blockedAt = 0; }")
    scene.page.evaluate(BLOCK, BLOCKED_MS)
    time.sleep(FIRST_PRESS_S)
    yield None


@contextmanager
def hidden(scene: Scene) -> Iterator[float | None]:
    """Hide the page; a throttle that is held would be let go."""
    scene.page.evaluate(
        "() => { const hidden = { get: () => true, configurable: true };"
        " Object.defineProperty(document, 'hidden', hidden);"
        " if (!document.querySelector('.held'))"
        " document.dispatchEvent(new Event('visibilitychange')); }"
    )
    yield None


@contextmanager
def lost_connection(scene: Scene) -> Iterator[float | None]:
    """Suspend the browser's network process: nothing comes and nothing is closed."""
    network = [
        process
        for process in psutil.Process().children(recursive=True)
        if "network.mojom" in " ".join(process.cmdline())
    ]
    assert network
    for process in network:
        process.suspend()
    try:
        time.sleep(FIRST_PRESS_S)
        yield None
    finally:
        for process in network:
            process.resume()


@contextmanager
def hung_server(scene: Scene) -> Iterator[float | None]:
    with hanging(scene.web):
        time.sleep(FIRST_PRESS_S)
        yield None


@contextmanager
def dead_server(scene: Scene) -> Iterator[float | None]:
    killed = time.time()
    scene.web.process.kill()
    yield killed


@contextmanager
def loading_pages(scene: Scene) -> Iterator[float | None]:
    """Load the page in eight windows at once."""
    context = scene.browser.new_context()
    pages = [context.new_page() for _ in range(LOADING_PAGES)]
    for page in pages:
        page.evaluate("url => { location.href = url; }", scene.web.url)
    try:
        yield None
    finally:
        context.close()


@contextmanager
def command(scene: Scene) -> Iterator[float | None]:
    begun = time.time()
    words = [sys.executable, "-m", "benchtool", "stop"]
    environment = {**os.environ, "BENCHTOOL_STATE": str(scene.state)}
    process = subprocess.Popen(words, env=environment, stdout=subprocess.DEVNULL)
    try:
        yield begun
    finally:
        process.wait(20)


SITUATIONS: dict[str, Callable[[Scene], AbstractContextManager[float | None]]] = {
    "idle": idle,
    "blocked main thread": blocked,
    "hidden tab": hidden,
    "lost connection": lost_connection,
    "hung server": hung_server,
    "eight loading clients": loading_pages,
    "`benchtool stop`": command,
    "dead server": dead_server,
}


def measure(scene: Scene, situation: str) -> float:
    """Return the time from the press, or from the event, to zero at the device: s."""
    scene.turn()
    with SITUATIONS[situation](scene) as event:
        since = scene.press() if event is None else event
        return scene.device.zero_after(since, ZERO_TIMEOUT_S)


def finish(scene: Scene, situation: str) -> None:
    """Leave the situation, and end a run that is paused, so that the next trial can begin."""
    page = scene.page
    page.keyboard.up("Escape")
    page.mouse.up()
    if situation == "hidden tab":
        page.evaluate(
            "() => { delete document.hidden;"
            " document.dispatchEvent(new Event('visibilitychange')); }"
        )
    page.wait_for_function("!document.body.matches('.server-lost')")
    if scene.kind == "hand throttle":
        return
    deadline_s = time.monotonic() + 30.0
    while not ENDED.search(text := page.locator(".status-line").inner_text()):
        assert time.monotonic() < deadline_s, text
        if " paused" in text:
            page.keyboard.press("Escape")
        page.wait_for_timeout(100)
    go_to(page, "Bench")


def count(kind: str, situation: str, counted: LongCount, number: int) -> None:
    """Measure so often; after a dead server on a new one."""
    left = number - sum(
        (row["kind"], row["situation"]) == (kind, situation)
        for row in map(json.loads, counted.lines)
    )
    from playwright.sync_api import Error as PlaywrightError

    while left > 0:
        # A busy machine may not get to open a dialog in time; trials then go on with a new scene.
        with (
            suppress(PlaywrightError, AssertionError),
            tempfile.TemporaryDirectory() as folder,
            ExitStack() as stack,
        ):
            scene = Scene(kind, Path(folder), stack)
            while left > 0:
                zero_s = measure(scene, situation)
                if zero_s > 0.0:  # else the watch was faster than the press
                    row = {"kind": kind, "situation": situation, "zero_s": zero_s}
                    counted.add(json.dumps({**row, "load": os.getloadavg()[0]}))
                    left -= 1
                if situation == "dead server":
                    break
                finish(scene, situation)


def table(lines: list[str]) -> str:
    """Return median and worst of each kind and situation, in ms, with the number of trials."""
    rows = ["| | " + " | ".join(KINDS) + " |", "|---" * (1 + len(KINDS)) + "|"]
    trials = [json.loads(line) for line in lines]
    for situation in SITUATIONS:
        cells = []
        for kind in KINDS:
            zeros_ms = [
                1e3 * trial["zero_s"]
                for trial in trials
                if (trial["kind"], trial["situation"]) == (kind, situation)
            ]
            cells.append(
                f"{np.median(zeros_ms):.0f}, {max(zeros_ms):.0f} ({len(zeros_ms)})"
                if zeros_ms
                else "–"
            )
        rows.append(f"| {situation} | {' | '.join(cells)} |")
    loads = [trial["load"] for trial in trials]
    return "\n".join([*rows, "", f"load {min(loads):.1f} to {max(loads):.1f}"]) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=50)
    parser.add_argument("--table", type=Path, default=Path("build/stop-times.md"))
    arguments = parser.parse_args()
    with LongCount(arguments.table.with_suffix(".jsonl"), None, "trials") as counted:
        for number in range(min(ROUND, arguments.count), arguments.count + 1, ROUND):
            for situation, kind in product(SITUATIONS, KINDS):
                count(kind, situation, counted, number)
        text = table(counted.lines)
    arguments.table.write_text(text)
    print(text)


if __name__ == "__main__":
    main()
