"""A short sweep as somebody starts it on the page."""

from __future__ import annotations

from typing import TYPE_CHECKING

from benchtool.data.run.run import Run
from tests.browser.conftest import Web, connect, go_to

if TYPE_CHECKING:
    from playwright.sync_api import Page

    from tests.browser.device import Device

SWEEP_MS = 60_000


def begin(page: Page, device: Device, repeats: int = 1, distances: str = "0.6,1") -> None:
    """Connect and start a sweep of one pulse."""
    connect(page, device.address)
    start(page, repeats, distances)


def start(page: Page, repeats: int, distances: str) -> None:
    """Start a sweep of one pulse on the bench that is connected."""
    go_to(page, "Sweep")
    for label, text in (
        ("Plate distances, z/R", distances),
        ("Pulses, us", "1500"),
        ("Repeats", str(repeats)),
        ("Samples of a point, s", "1"),
    ):
        page.get_by_label(label).fill(text)
    page.get_by_text(f"settings: {repeats} repeats").wait_for()
    page.get_by_role("button", name="Start the sweep").click()
    page.get_by_text("expected thrust: about").wait_for()
    page.get_by_role("button", name="Start", exact=True).click()


def only_run(web: Web) -> Run:
    """Return the run that was made."""
    (path,) = web.runs.iterdir()
    return Run.open(path)


def wait_for_points(page: Page, count: int) -> None:
    """Wait until so many visits are done."""
    done = r"Number(document.body.innerText.match(/(\d+) of \d+ visits/)?.[1])"
    page.wait_for_function(f"{done} >= {count}", timeout=SWEEP_MS)
