"""Print how soon a moved slider is drawn on the Simulate tab; the aim is 100 ms.

Measured in the page, from the key that moves the slider to the second picture after everything was
drawn: the key's event to the server, a simulation of every controller in the worker, its numbers
to the browser, drawings and charts. A picture of the animation runs all the while, and a browser
without a graphics card draws it on the processor. The machine's load is printed, because two cores
that others use, too, say nothing about the page.
"""

from __future__ import annotations

import os
import shutil
import statistics
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.browser.conftest import CHROMIUM, serving

if TYPE_CHECKING:
    from playwright.sync_api import Page

MOVES = 40
STILL_MS = 500
"""Between two moves, so that each is drawn, quickly and whole, before the next."""

COMPILES_MS = 150_000

WATCH = """() => {
  window.pressed = null;
  window.took = [];
  window.addEventListener("keydown", () => { window.pressed = performance.now(); }, true);
  new MutationObserver(() => {
    if (window.pressed !== null) window.took.push(performance.now() - window.pressed);
    window.pressed = null;
  }).observe(document.querySelector(".side-views"), { attributeFilter: ["data-drawn"] });
}"""


def moved_ms(page: Page, label: str) -> list[float]:
    """Move a slider again and again; return how long each took to be drawn."""
    page.evaluate(WATCH)
    page.get_by_role("slider", name=label).locator(".q-slider__track-container").focus()
    for count in range(MOVES):
        page.keyboard.press("ArrowRight" if count % 20 < 10 else "ArrowLeft")
        page.wait_for_function("count => window.took.length > count", arg=count)
        page.wait_for_timeout(STILL_MS)
    took: list[float] = page.evaluate("window.took")
    return took


def told(name: str, took_ms: list[float]) -> str:
    """Say the median and the worst."""
    ranked = sorted(took_ms)
    return (
        f"{name:12s} median {statistics.median(ranked):.0f} ms, nine of ten within "
        f"{ranked[int(0.9 * len(ranked))]:.0f} ms, worst {ranked[-1]:.0f} ms, n {len(ranked)}"
    )


def main() -> None:
    """Measure both kinds of simulation."""
    if CHROMIUM is None:
        print("no browser is installed; on Debian or Ubuntu: apt install chromium")
        return
    from playwright.sync_api import sync_playwright

    place = Path(tempfile.mkdtemp())
    try:
        with serving(place / "runs", place / "state") as web, sync_playwright() as tool:
            browser = tool.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": 1280, "height": 900})
            page.goto(f"{web.url}?tab=simulate")
            page.locator(".side-views[data-drawn]").wait_for(timeout=COMPILES_MS)
            load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
            print(f"load of the machine before: {load:.1f} on {os.cpu_count()} cores")
            page.wait_for_timeout(STILL_MS)
            print(told("pitch bench", moved_ms(page, "Plate distance z/R [–]")))
            page.get_by_role("button", name="flight", exact=True).click()
            page.get_by_text("position along the way [m]").or_(
                page.get_by_role("slider", name="Height z/R [–]")
            ).first.wait_for()
            page.wait_for_timeout(4 * STILL_MS)
            print(told("flight", moved_ms(page, "Height z/R [–]")))
            browser.close()
    finally:
        shutil.rmtree(place)


if __name__ == "__main__":
    main()
