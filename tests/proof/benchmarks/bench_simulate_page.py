"""Print how soon a moved slider is drawn on the Simulate tab; the aim is 100 ms.

Measured in the page, from the key that moves the slider to the second picture after everything was
drawn. The server's part ends when its message is in the browser: the key's event, a simulation of
every controller in the worker, its numbers as text. The browser's part is the rest: drawings,
charts, two pictures. The animation runs all the while, and a browser without a graphics card draws
it on the processor. The machine's load is printed, because two cores that others use, too, say
nothing about the page; `chrt --rr 1` before the command, as root, puts it before the others.
"""

from __future__ import annotations

import os
import shutil
import statistics
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

sys.path.insert(0, str(Path(__file__).parents[3]))

from tests.browser.conftest import CHROMIUM, serving

if TYPE_CHECKING:
    from playwright.sync_api import Page

MOVES = 40
STILL_MS = 500
"""Between two moves, so that each is drawn, quickly and whole, before the next."""

COMPILES_MS = 150_000

HEAR = """() => {
  const Plain = window.WebSocket;
  window.WebSocket = class extends Plain {
    constructor(...given) {
      super(...given);
      this.addEventListener("message", ({ data }) => {
        if ((data.length ?? 0) > %d) window.came ??= performance.now();
      });
    }
  };
}"""
"""Notes when the message with the numbers comes, before the page hears of it."""

LONG_MESSAGE = 20_000
"""Characters; a message with the numbers of a simulation is longer, any other is shorter."""

WATCH = """() => {
  window.pressed = null;
  window.took = [];
  window.addEventListener("keydown", () => {
    window.pressed = performance.now();
    window.came = undefined;
  }, true);
  new MutationObserver(() => {
    const [begun, came] = [window.pressed, window.came];
    window.pressed = null;
    if (begun !== null) window.took.push([came - begun, performance.now() - came]);
  }).observe(document.querySelector(".side-views"), { attributeFilter: ["data-drawn"] });
}"""


def moved_ms(page: Page, label: str) -> list[tuple[float, float]]:
    """Move a slider again and again; return the server's and the browser's part of each time."""
    page.evaluate(WATCH)
    page.get_by_role("slider", name=label).locator(".q-slider__track-container").focus()
    for count in range(MOVES):
        page.keyboard.press("ArrowRight" if count % 20 < 10 else "ArrowLeft")
        page.wait_for_function("count => window.took.length > count", arg=count)
        page.wait_for_timeout(STILL_MS)
    took: list[tuple[float, float]] = page.evaluate("window.took")
    return took


def told(name: str, took_ms: list[tuple[float, float]]) -> str:
    """Say the best, the median and the worst of the whole and of its parts."""
    parts = {
        "drawn after": [server + browser for server, browser in took_ms],
        "server": [server for server, _ in took_ms],
        "browser": [browser for _, browser in took_ms],
    }
    lines = [f"{name}, n {len(took_ms)}, load of the machine {_load():.1f}"]
    for part, values in parts.items():
        ranked = sorted(values)
        lines.append(
            f"  {part:12s} best {ranked[0]:4.0f}, median {statistics.median(ranked):4.0f}, nine of "
            f"ten within {ranked[int(0.9 * len(ranked))]:4.0f}, worst {ranked[-1]:4.0f} ms"
        )
    return "\n".join(lines)


def _load() -> float:
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")


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
            page.add_init_script(f"({HEAR % LONG_MESSAGE})()")
            page.goto(f"{web.url}?tab=simulate")
            page.locator(".side-views[data-drawn]").wait_for(timeout=COMPILES_MS)
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
