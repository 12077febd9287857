"""Fixtures: a real browser, the web server, and a virtual bench on a pseudo-terminal.

Tests use `page` (with the control lock), `web` (server and runs folder) and, if a bench is needed,
`device`. `connect` connects page and device, `begin` starts a sweep.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from benchtool.data.run.run import Run
from tests.browser.device import Device, served_device

if TYPE_CHECKING:
    from playwright.sync_api import Locator, LocatorAssertions, Page


CHROMIUM = next(
    (
        path
        for name in ("chromium", "chromium-browser", "google-chrome")
        if (path := shutil.which(name))
    ),
    None,
)
TIMEOUT_MS = 20_000


@dataclass(frozen=True)
class Web:
    """Server with printed address, runs folder and process."""

    url: str
    runs: Path
    process: subprocess.Popen[str]


@pytest.fixture(scope="module")
def browser():
    """Return a headless browser; skip if none is installed.

    Not session-scoped: its event loop would run during tests of other folders.
    """
    if os.name != "posix":
        pytest.skip("the virtual bench of these tests needs pseudo-terminals")
    if CHROMIUM is None:
        pytest.skip("no browser is installed; on Debian or Ubuntu: apt install chromium")
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as tool:
        chromium = tool.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        yield chromium
        chromium.close()


@contextmanager
def serving(runs: Path, state: Path, *options: str) -> Iterator[Web]:
    """Run `benchtool web` until the end of the block."""
    # NiceGUI behaves differently if it detects pytest.
    environment = {key: text for key, text in os.environ.items() if not key.startswith("PYTEST_")}
    arguments = ["web", "--port", "0", "--no-browser", *options, "--runs", str(runs)]
    process = subprocess.Popen(
        [sys.executable, "-m", "benchtool", *arguments],
        stdout=subprocess.PIPE,
        text=True,
        env={**environment, "BENCHTOOL_STATE": str(state)},
    )
    assert process.stdout is not None
    try:
        url = process.stdout.readline().strip()
        assert url.startswith("http://127.0.0.1:"), url
        yield Web(url, runs, process)
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.wait(20)
        process.stdout.close()


@pytest.fixture
def web(browser, tmp_path):
    """Return a new server."""
    with serving(tmp_path / "runs", tmp_path / "state") as server:
        yield server


@pytest.fixture
def device():
    """Return a virtual quadrotor bench in real time."""
    with served_device() as served:
        yield served


@pytest.fixture
def fast_device():
    """Return a virtual quadrotor bench with real-time factor 5."""
    with served_device(speed=5.0) as served:
        yield served


@pytest.fixture
def open_page(browser):
    """Return a function that opens an address in a new window; script errors fail the test."""
    contexts, errors = [], []

    def open_url(url: str) -> Page:
        context = browser.new_context(viewport={"width": 1280, "height": 900})
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(url)
        return page

    yield open_url
    for context in contexts:
        context.close()
    assert errors == []


@pytest.fixture
def page(web, open_page):
    """Return a page with the control lock."""
    page = open_page(web.url)
    page.get_by_text("this page controls", exact=True).wait_for()
    return page


def expect(element: Locator) -> LocatorAssertions:
    """Return playwright's assertions about an element, which wait until they are true.

    Immediately after an action, the page can still show the previous state.
    """
    from playwright import sync_api

    sync_api.expect.set_options(timeout=TIMEOUT_MS)
    return sync_api.expect(element)


def centre(element: Locator) -> tuple[float, float]:
    """Return the centre of an element; wait until a changing tab has placed it."""
    while (box := element.bounding_box()) is None:
        element.wait_for()
    return box["x"] + box["width"] / 2.0, box["y"] + box["height"] / 2.0


def connect(page: Page, address: str, rig: str = "pquad") -> None:
    """Connect a page to a bench and wait for its charts to move."""
    page.get_by_label("Address of the bench").fill(address)
    if not address.startswith("sim:"):
        page.get_by_label("Rig", exact=True).click()
        page.get_by_role("option", name=rig, exact=True).click()
    page.get_by_role("button", name="Connect", exact=True).click()
    page.wait_for_function("Number(document.querySelector('.strips')?.dataset.frames) > 5")


def go_to(page: Page, tab: str) -> None:
    """Open a tab."""
    page.get_by_role("tab", name=tab).click()


SWEEP_MS = 60_000


def begin(
    page: Page,
    device: Device,
    repeats: int = 1,
    distances: str = "0.6,1",
    *,
    needs_page: bool = True,
) -> None:
    """Connect and start a sweep of one pulse."""
    connect(page, device.address)
    start(page, repeats, distances, needs_page=needs_page)


def start(page: Page, repeats: int, distances: str, *, needs_page: bool = True) -> None:
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
    if not needs_page:
        page.get_by_role("checkbox", name="Let it run without this page").click()
    page.get_by_role("button", name="Start", exact=True).click()


def only_run(web: Web) -> Run:
    """Return the only run."""
    (path,) = web.runs.iterdir()
    return Run.open(path)


def wait_for_points(page: Page, count: int) -> None:
    """Wait until a number of points is measured."""
    n_measured = r"Number(document.body.innerText.match(/(\d+) of \d+ points/)?.[1])"
    page.wait_for_function(f"{n_measured} >= {count}", timeout=SWEEP_MS)
