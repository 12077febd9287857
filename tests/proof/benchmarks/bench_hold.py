"""Silence of a browser under load about a button that is held.

The dead-man time (`RELEASE_TIMEOUT_S` in `benchtool.web.bench_process.throttle`) is chosen from
these figures. Silence is what the server knows with each beat: the time since the last one, and the
age of the page's message in it. Charts of a 1 kHz bench play meanwhile, and processes that compute
take the processor away. Needs Chromium.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

from tests.browser.conftest import CHROMIUM, connect
from tests.proof.benchmarks.rows import Row

BEATS = "BENCHTOOL_BEATS_FILE"
HOGS = (0, 2, 4, 8)

if BEATS in os.environ:
    # In the server and in its bench process: note every beat, and never let go.
    from benchtool.web.bench_process.messages import HoldThrottle
    from benchtool.web.bench_process.throttle import DeadManSwitch

    def note(hand: DeadManSwitch, hold: HoldThrottle, now_s: float) -> None:
        with Path(os.environ[BEATS]).open("a") as file:
            file.write(f"{now_s:.4f} {hold.age_s:.4f}\n")
        hand._last = (
            HoldThrottle(hold.tab, hold.press, hold.command_pwm_us, hold.rotors),
            now_s + 1e6,
        )

    DeadManSwitch.hold = note  # type: ignore[method-assign]


def silence_ms(page: Page, beats: Path, hogs: int, seconds: float) -> np.ndarray:
    """Hold the button while processes compute, and return the silence before each beat: ms."""
    busy = [subprocess.Popen([sys.executable, "-c", "while 1: 0"]) for _ in range(hogs)]
    try:
        beats.write_text("")
        page.mouse.down()
        time.sleep(seconds)
        page.mouse.up()
    finally:
        for process in busy:
            process.kill()
            process.wait()
    page.wait_for_timeout(500)
    at, age = np.loadtxt(beats).T
    return 1e3 * (np.diff(at) + age[:-1])


def rows(quick: bool) -> Iterator[Row]:
    """Yield the median and the longest silence at every load."""
    if CHROMIUM is None:
        return
    with tempfile.TemporaryDirectory() as folder:
        beats = Path(folder) / "beats"
        server = subprocess.Popen(
            [sys.executable, __file__, folder],
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, BEATS: str(beats), "BENCHTOOL_STATE": folder},
        )
        assert server.stdout is not None
        try:
            url = server.stdout.readline().strip()
            with sync_playwright() as tool:
                browser = tool.chromium.launch(
                    executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
                )
                page = browser.new_page(viewport={"width": 1280, "height": 900})
                page.set_default_timeout(60_000)
                page.goto(url)
                page.get_by_text("this page controls", exact=True).wait_for()
                connect(page, "sim:pquad?rate=1000")
                page.locator(".hold-button:not([disabled])").hover()
                for hogs in HOGS[: 1 if quick else None]:
                    measured = silence_ms(page, beats, hogs, 2.0 if quick else 30.0)
                    work = f"held button, silence beside {hogs} computing processes"
                    yield Row(f"{work}, median", float(np.median(measured)), "ms")
                    yield Row(f"{work}, longest", float(measured.max()), "ms", wanted=500.0)
                browser.close()
        finally:
            server.terminate()
            server.wait(20)


if __name__ == "__main__":  # the server
    from benchtool.web.serve import serve

    serve(Path(sys.argv[1]) / "runs", "127.0.0.1", 0, lambda url: print(url, flush=True))
