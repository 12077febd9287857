"""Make the pictures of the page in the documentation: `python docs/assets/draw_web.py [FOLDER]`.

A server, a browser and a simulated bench of its own; every tab once, at 1280 pixels, in light. With
`--all FOLDER` also in dark, at 1920 and at 820 pixels, to look at.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

HERE = Path(__file__).parent
SIZES = {"": (1280, 900, "light")}
MORE = {
    "-dark": (1280, 900, "dark"),
    "-1920": (1920, 1080, "light"),
    "-1920-dark": (1920, 1080, "dark"),
    "-tablet": (820, 1180, "light"),
    "-tablet-dark": (820, 1180, "dark"),
}
SWEEP_MS = 120_000


@contextmanager
def served() -> Iterator[str]:
    """Give the address of a page with a folder of runs of its own."""
    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.Popen(
            [sys.executable, "-m", "benchtool", "web", "--port", "0", "--no-browser"],
            stdout=subprocess.PIPE,
            text=True,
            cwd=folder,
        )
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.terminate()
            process.wait(20)


def prepare(page: Page) -> None:
    """Connect a simulated bench and measure a small sweep."""
    page.get_by_text("at the controls").wait_for()
    page.get_by_role("button", name="Connect", exact=True).click()
    page.locator(".strips").wait_for()
    page.get_by_label("Virtual clock").click()
    page.get_by_text("20 times faster").click()
    page.get_by_role("tab", name="Sweep").click()
    page.get_by_label("Plate distances, z/R").fill("0.6,0.8,1,1.5,2,3")
    page.get_by_label("Repeats").fill("2")
    page.get_by_text("limits hold").wait_for()
    page.get_by_role("button", name="Start the sweep").click()
    page.get_by_role("button", name="Start", exact=True).click()
    page.get_by_text(re.compile("^ended: ")).wait_for(timeout=SWEEP_MS)
    page.get_by_role("tab", name="Bench").click()
    page.get_by_label("Virtual clock").click()
    page.get_by_text("as in life").click()


def spin(page: Page) -> None:
    """Turn the motors by hand twice, and leave the pointer down."""
    page.locator(".hold-button:not([disabled])").hover()
    for seconds in (3, 3):
        page.mouse.up()
        page.wait_for_timeout(2000)
        page.mouse.down()
        page.wait_for_timeout(1000 * seconds)


def pictures(page: Page, folder: Path, sizes: dict[str, tuple[int, int, str]]) -> None:
    """Save every tab in every size."""
    tabs = page.get_by_role("tab").all_inner_texts()
    for suffix, (width, height, scheme) in sizes.items():
        page.set_viewport_size({"width": width, "height": height})
        page.emulate_media(color_scheme="dark" if scheme == "dark" else "light")
        for text in tabs:
            name = text.split("\n")[-1]
            page.get_by_role("tab", name=name).click()
            page.wait_for_timeout(2000)
            page.locator(".q-spinner:visible").first.wait_for(state="hidden")
            page.wait_for_timeout(2000)
            turns = name == "Bench"
            if turns:
                spin(page)
            path = folder / f"web-{name.lower()}{suffix}.png"
            page.screenshot(path=path)
            if turns:
                page.mouse.up()
            print(path)


def main(words: list[str]) -> None:
    """Make the pictures."""
    every = "--all" in words
    folders = [Path(word) for word in words if not word.startswith("-")]
    folder = folders[0] if folders else HERE
    browser_path = shutil.which("chromium") or shutil.which("google-chrome")
    with served() as address, sync_playwright() as tool:
        browser = tool.chromium.launch(
            executable_path=browser_path, args=["--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        page.set_default_timeout(60_000)
        page.goto(address)
        prepare(page)
        pictures(page, folder, {**SIZES, **(MORE if every else {})})
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1:])
