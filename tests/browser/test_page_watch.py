"""Runs that need their page: blocked, closed and hidden pages, unresponsive servers."""

from __future__ import annotations

import re
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import pytest

from benchtool.web.bench_process.process import MAX_SERVER_SILENCE_S
from benchtool.web.context import MAX_BLOCKED_S
from tests.browser.conftest import Web, begin, centre, expect, only_run
from tests.browser.device import Device

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.real_time(deadline_s=0.1)

STOPPED_S = 0.3  # maximum time from a press or the end of a timeout to zero at the device

BLOCK = """milliseconds => setTimeout(() => {
  const end = performance.now() + milliseconds;
  window.blockedAt = Date.now() / 1000;
  while (performance.now() < end);
}, 0)"""


def wait_until_turning(page: Page, device: Device) -> None:
    """Wait until a sweep has reached its pulse width."""
    for _ in range(300):
        if device.turning_us() >= 1500.0:
            return
        page.wait_for_timeout(50)
    raise AssertionError(f"motors were not turned: {device.orders[-5:]}")


@contextmanager
def hanging(web: Web) -> Iterator[float]:
    """Suspend the server; return the wall time of the suspension."""
    web.process.send_signal(signal.SIGSTOP)
    try:
        yield time.time()
    finally:
        web.process.send_signal(signal.SIGCONT)


def test_a_page_that_is_blocked_pauses_its_sweep(page, web, device):
    begin(page, device, repeats=9)
    wait_until_turning(page, device)
    page.evaluate(BLOCK, 3500)
    page.wait_for_function("window.blockedAt")
    zero_s = device.zero_after(page.evaluate("window.blockedAt"))
    assert zero_s < MAX_BLOCKED_S + STOPPED_S
    page.get_by_text("paused: ").first.wait_for()
    page.get_by_text("the page with the control lock was blocked").first.wait_for()
    page.get_by_role("button", name="Continue", exact=True).click()
    wait_until_turning(page, device)
    assert only_run(web).metadata["needs_page"] is True


def test_a_page_that_is_closed_pauses_its_sweep_and_another_goes_on(page, web, device):
    begin(page, device, repeats=9)
    wait_until_turning(page, device)
    other = page.context.new_page()
    other.goto(f"{web.url}?tab=sweep")
    other.get_by_text("watching").wait_for()
    closed = time.time()
    page.close()
    assert device.zero_after(closed) < STOPPED_S
    other.get_by_text("paused: ").first.wait_for()
    other.get_by_role("button", name="Take over").click()
    other.get_by_role("button", name="Continue", exact=True).click()
    wait_until_turning(other, device)


def test_a_hidden_page_keeps_its_watch_and_names_what_turns(page, device):
    begin(page, device, repeats=9)
    wait_until_turning(page, device)
    expect(page.locator(".status-line")).to_contain_text(re.compile(r"motors at 1500 us, \d+ rpm"))
    expect(page.locator(".status-line")).to_contain_text(re.compile(r"sweep .* running, .* left"))
    page.evaluate(
        "() => { Object.defineProperty(document, 'hidden', { get: () => true });"
        " document.dispatchEvent(new Event('visibilitychange')); }"
    )
    page.wait_for_function("document.title.startsWith('motors at 1')")
    page.evaluate(BLOCK, 3000)
    page.wait_for_timeout(3200)
    expect(page.locator(".status-line")).to_contain_text("running")


def test_a_server_that_hangs_stops_the_sweep(page, web, device):
    begin(page, device, repeats=9)
    wait_until_turning(page, device)
    with hanging(web) as hung:
        assert device.zero_after(hung) < MAX_SERVER_SILENCE_S + STOPPED_S
    page.get_by_text("stopped: ").first.wait_for()
    assert "no heartbeat" in only_run(web).metadata["reason"]


def test_stop_does_not_need_the_server(page, web, device):
    begin(page, device, repeats=9)
    wait_until_turning(page, device)
    page.mouse.move(*centre(page.locator(".stop-button")))
    with hanging(web):
        pressed = time.time()
        page.mouse.down()
        assert device.zero_after(pressed) < STOPPED_S


def test_stop_stays_in_sight_under_two_fingers_and_esc_stops_while_text_is_composed(page, device):
    begin(page, device, repeats=9)
    wait_until_turning(page, device)
    session = page.context.new_cdp_session(page)
    session.send("Emulation.setPageScaleFactor", {"pageScaleFactor": 3})
    in_sight = page.wait_for_function(
        "() => { const { left, top, right, bottom } = document.querySelector('.stop-button')"
        ".getBoundingClientRect(), { scale, offsetLeft: x, offsetTop: y } = visualViewport;"
        " const { width, height } = visualViewport; return scale > 2.9 && Math.min("
        "left - x, top - y, x + width - right, y + height - bottom) > -1; }",
        timeout=2000,
    )
    assert in_sight.json_value()
    session.send("Emulation.setPageScaleFactor", {"pageScaleFactor": 1})
    page.get_by_label("Repeats").focus()
    session.send("Input.imeSetComposition", {"text": "n", "selectionStart": 1, "selectionEnd": 1})
    page.locator(".stop-note").get_by_text("Press the STOP button to stop").wait_for()
    pressed = time.time()
    key = {"key": "Process", "code": "Escape", "windowsVirtualKeyCode": 229}
    session.send("Input.dispatchKeyEvent", {"type": "rawKeyDown", **key})
    assert device.zero_after(pressed) < STOPPED_S
