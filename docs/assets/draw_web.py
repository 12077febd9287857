"""Make the pictures of the page in the documentation: `python docs/assets/draw_web.py [FOLDER]`.

A server, a browser and a simulated bench of its own; every tab is filled as a user fills it, then
taken at 1280 pixels, in light. With `--all FOLDER` also whole, in light and dark, at 820, 1280 and
1920 pixels, to look at. It takes some minutes: a sweep, a fit with emcee, an explanation.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import product
from pathlib import Path
from typing import Literal

from PIL import Image
from playwright.sync_api import Locator, Page, sync_playwright

HERE = Path(__file__).parent
WIDTHS = (820, 1280, 1920)
HEIGHT = 900
SCHEMES: tuple[Literal["light", "dark"], ...] = ("light", "dark")
LONG_MS = 1_200_000
COLOURS = 256
"""A picture of few colours is a third of the size."""


@contextmanager
def served() -> Iterator[str]:
    """Give the address of a page with a folder of runs of its own."""
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.Popen(
            [sys.executable, "-m", "benchtool", "web", "--port", "0", "--no-browser"],
            stdout=subprocess.PIPE,
            text=True,
            cwd=folder,
            env={**os.environ, "LOGNAME": "somebody"},
        )
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.terminate()
            process.wait(20)


def choose(page: Page, label: str, option: str) -> None:
    """Choose from a list."""
    page.get_by_label(label, exact=True).locator("visible=true").click()
    page.get_by_role("option", name=option).first.click()
    # A list of several stays open; a click where nothing is closes it.
    page.mouse.click(5.0, 5.0)


def fill(page: Page, label: str, text: str) -> None:
    """Type into a field."""
    page.get_by_label(label, exact=True).locator("visible=true").fill(text)


def sweep(page: Page) -> None:
    """Connect a simulated bench and measure a small sweep, fast; then let it run in real time."""
    page.get_by_text("this page controls", exact=True).wait_for()
    page.get_by_role("button", name="Connect", exact=True).click()
    page.locator(".strips").wait_for()
    choose(page, "Virtual clock", "20 times faster")
    page.get_by_role("tab", name="Sweep").click()
    page.get_by_label("Plate distances, z/R").fill("0.6,0.8,1,1.5,2,3")
    page.get_by_label("Repeats").fill("2")
    page.get_by_text("expected maxima").wait_for()
    page.get_by_role("button", name="Start the sweep").click()
    page.get_by_role("button", name="Start", exact=True).click()
    page.get_by_text(re.compile("^ended: ")).wait_for(timeout=LONG_MS)
    page.get_by_role("tab", name="Bench").click()
    choose(page, "Virtual clock", "real time")


def fit(page: Page) -> None:
    """Open the sweep under Runs, and fit it with the button there."""
    page.get_by_role("tab", name="Runs").click()
    page.locator(".run-name", has_text="sweep").click()
    page.get_by_role("button", name="Fit", exact=True).click()
    page.get_by_text("emcee (posterior samples)").click()
    page.get_by_role("button", name="Fit", exact=True).click()
    page.get_by_role("button", name="More figures").wait_for()


def explain(page: Page) -> None:
    """Simulate a bench that hides friction twice, and have it explained."""
    page.get_by_role("tab", name="Simulate").click()
    choose(page, "Rig on the hinge", "beam")
    choose(page, "Gains", "stiff")
    fill(page, "Numbers, as gains.attitude=1.2", "coulomb_friction.torque_Nm=0.013")
    fill(page, "Duration, s", "20")
    for schedule, seed in (("triangle", "2"), ("identify", "1")):
        choose(page, "Schedule, or its file", schedule)
        fill(page, "Seed of the noise", seed)
        page.get_by_role("button", name="Simulate", exact=True).click()
        page.locator(".card-title", has_text=f"-pitch-{schedule}").wait_for(timeout=LONG_MS)
    page.get_by_role("button", name="Explain", exact=True).click()
    page.get_by_text("no validation recording").wait_for()
    choose(page, "Validation recordings", "-pitch-triangle/pid.csv")
    page.get_by_role("button", name="Explain", exact=True).locator("visible=true").click()
    page.get_by_text("The gap", exact=True).or_(page.get_by_role("alert")).first.wait_for()
    page.get_by_role("button", name="Accept").click()
    page.get_by_text("was written to").wait_for()


def spin(page: Page) -> None:
    """Turn the motors by hand twice."""
    page.locator(".hold-button:not([disabled])").hover()
    for _ in range(2):
        page.mouse.down()
        page.wait_for_timeout(3000)
        page.mouse.up()
        page.wait_for_timeout(2000)


def quiet(page: Page) -> None:
    """Wait until nothing is being made ready, and nothing moves."""
    page.mouse.move(2, 2)
    page.locator(".q-notification").first.wait_for(state="hidden")
    page.wait_for_timeout(1500)
    page.wait_for_function(
        "![...document.querySelectorAll('.q-spinner')].some((one) => one.checkVisibility())"
    )
    page.wait_for_timeout(1500)


def picture(shown: Page | Locator, path: Path) -> None:
    """Take what is on the screen, in few colours."""
    image = Image.open(io.BytesIO(shown.screenshot())).convert("RGB")
    image.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
    print(path, f"{path.stat().st_size / 1000:.0f} kB", flush=True)


def arrange(page: Page, tab: str) -> None:
    """Bring onto the screen what the picture of a tab is to show."""
    page.evaluate("scrollTo(0, 0)")
    if tab == "Bench":
        spin(page)
    elif tab == "Runs":
        page.locator(".run-name", has_text="sweep").last.click()
        page.locator("figure.shown:visible").first.wait_for()
    elif tab in ("Fit", "Explain"):
        place = page.locator(".scroll-place:visible").last
        place.evaluate("place => place.scrollIntoView()")
    quiet(page)


def whole(page: Page, tab: str, folder: Path) -> None:
    """Take a whole tab in every size, and say where it is wider than the screen."""
    for width, scheme in product(WIDTHS, SCHEMES):
        page.emulate_media(color_scheme=scheme)
        page.set_viewport_size({"width": width, "height": HEIGHT})
        quiet(page)
        height = page.evaluate("document.documentElement.scrollHeight")
        page.set_viewport_size({"width": width, "height": max(height, HEIGHT)})
        quiet(page)
        wide = page.evaluate("document.documentElement.scrollWidth")
        if wide > width:
            print(f"{tab} is {wide} wide on a screen of {width}")
        picture(page, folder / f"look-{tab.lower()}-{width}-{scheme}.png")


def pictures(page: Page, folder: Path, *, every: bool) -> None:
    """Take every tab as the documentation shows it; with `every` in all sizes, whole."""
    for name in page.get_by_role("tab").all_inner_texts():
        tab = name.split("\n")[-1]
        page.set_viewport_size({"width": 1280, "height": HEIGHT})
        page.emulate_media(color_scheme="light")
        page.get_by_role("tab", name=tab).click()
        quiet(page)
        arrange(page, tab)
        picture(page, folder / f"web-{tab.lower()}.png")
        if tab == "Fit":
            page.get_by_role("button", name="More figures").click()
            page.wait_for_timeout(2000)  # it opens slowly, and moves what is below
            corner = page.locator("figure.shown", has_text="Pairwise posterior draws")
            page.set_viewport_size({"width": 1280, "height": 3 * HEIGHT})  # below the header
            picture(corner, folder / "web-fit-corner.png")
            page.set_viewport_size({"width": 1280, "height": HEIGHT})
        if every:
            whole(page, tab, folder)


def main(words: list[str]) -> None:
    """Make the pictures."""
    folders = [Path(word) for word in words if not word.startswith("-")]
    folder = folders[0] if folders else HERE
    browser_path = shutil.which("chromium") or shutil.which("google-chrome")
    with served() as address, sync_playwright() as tool:
        browser = tool.chromium.launch(
            executable_path=browser_path, args=["--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page(viewport={"width": 1280, "height": HEIGHT})
        page.set_default_timeout(LONG_MS)
        page.goto(address)
        for prepare in (sweep, explain, fit):
            prepare(page)
            print(f"{prepare.__name__} is done", flush=True)
        pictures(page, folder, every="--all" in words)
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1:])
