"""Print how long a browser under load is silent about a button that is held.

The dead-man time (`RELEASE_TIMEOUT_S` in `benchtool.web.bench_process.throttle`) is chosen from
these figures. Silence is what the server knows with each beat: the time since the last one, and the
age of the page's word in it. Charts of a 1 kHz bench play meanwhile, and processes that do nothing
but compute take the processor away. Needs Chromium.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from playwright.sync_api import Page, sync_playwright

sys.path.insert(0, str(Path(__file__).parents[3]))

from tests.browser.conftest import CHROMIUM, connect

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


def measure(page: Page, beats: Path, hogs: int, seconds: float) -> str:
    """Hold the button while processes compute, and return a row of figures in ms."""
    busy = [subprocess.Popen([sys.executable, "-c", "while 1: 0"]) for _ in range(hogs)]
    try:
        beats.write_text("")
        page.mouse.down()
        time.sleep(seconds)
        page.mouse.up()
        load = os.getloadavg()[0]
    finally:
        for process in busy:
            process.kill()
            process.wait()
    page.wait_for_timeout(500)
    at, age = np.loadtxt(beats).T
    silence_ms = 1e3 * (np.diff(at) + age[:-1])
    shares = [*np.percentile(silence_ms, [50, 99, 99.9]), silence_ms.max()]
    figures = " | ".join(f"{figure:.0f}" for figure in shares)
    worst = 1e3 * np.diff(at).max(), 1e3 * age.max()
    return (
        f"| {hogs} | {load:.1f} | {len(at)} | {figures} | {worst[0]:.0f} | {worst[1]:.0f} | "
        f"{int((silence_ms > 500.0).sum())} |"
    )


def main() -> None:
    """Print a row for every load."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--seconds", type=float, default=30.0)
    given = words.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        beats = Path(folder) / "beats"
        server = subprocess.Popen(
            [sys.executable, __file__, "serve", folder],
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, BEATS: str(beats), "BENCHTOOL_STATE": folder},
        )
        assert server.stdout is not None
        try:
            url = server.stdout.readline().strip()
            print("| hogs | load | beats | median | 99 % | 99.9 % | worst | gap | age | > 500 ms |")
            with sync_playwright() as tool:
                browser = tool.chromium.launch(
                    executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
                )
                page = browser.new_page(viewport={"width": 1280, "height": 900})
                page.set_default_timeout(60_000)
                page.goto(url)
                page.get_by_text("at the controls", exact=True).wait_for()
                connect(page, "sim:pquad?rate=1000")
                page.locator(".hold-button:not([disabled])").hover()
                for hogs in HOGS:
                    print(measure(page, beats, hogs, given.seconds), flush=True)
                browser.close()
        finally:
            server.terminate()
            server.wait(20)


if __name__ == "__main__":
    if sys.argv[1:2] == ["serve"]:
        from benchtool.web.serve import serve

        serve(Path(sys.argv[2]) / "runs", "127.0.0.1", 0, lambda url: print(url, flush=True))
    else:
        main()
