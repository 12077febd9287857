from __future__ import annotations

import signal
import time
from typing import TYPE_CHECKING

import psutil
import pytest

from benchtool.web.bench_process.throttle import RELEASE_TIMEOUT_S
from tests.browser.conftest import CHROMIUM, centre, connect, expect
from tests.browser.device import Device

if TYPE_CHECKING:
    from playwright.sync_api import Page


pytestmark = pytest.mark.real_time(deadline_s=0.1)

STOPPED_S = 0.3  # maximum time from release, STOP or dead-man timeout to zero at the device


def hold(page: Page, device: Device, presses: int = 6) -> None:
    """Press the throttle button until motors turn, and keep it pressed.

    If the machine stalls for a moment, the dead-man switch releases the throttle: press again.
    """
    for _ in range(presses):
        page.locator(".hold-button:not([disabled])").hover()
        page.mouse.down()
        for _ in range(40):
            page.wait_for_timeout(50)
            if device.turning_us() >= 1100.0:
                return
        page.mouse.up()
    raise AssertionError(f"motors were not turned: {device.orders[-5:]}")


def test_a_bench_on_a_port_is_seen_live(page, device):
    connect(page, device.address)
    expect(page.get_by_role("status").first).to_contain_text(device.address)
    page.get_by_text("virtual-pquad-0 (virtual)").wait_for()
    frames = "Number(document.querySelector('.strips').dataset.frames)"
    before, start_s = page.evaluate(frames), time.monotonic()
    page.wait_for_timeout(2000)
    rate_Hz = (page.evaluate(frames) - before) / (time.monotonic() - start_s)
    assert rate_Hz > 10.0
    # Chart lines have breaks where samples are missing, but not at late frames or slow benches.
    gaps = "async (frames) => (await import('/static/strip_chart.js')).findGaps(frames)"
    steady = [[0.05 * i, 50, 0] for i in range(4)]
    for frame, is_gap in (([2.0, 1850, 0], False), ([0.2, 49, 1], True), ([1.5, 0, 0], True)):
        assert page.evaluate(gaps, [*steady, frame]) == [False] * 4 + [is_gap]
    slow = [[0.0, 1, 0], [0.05, 0, 0], [0.5, 1, 0], [0.9, 0, 0], [1.0, 1, 0]]
    assert page.evaluate(gaps, slow) == [False] * 5
    page.get_by_role("button", name="Connection").click()
    command = f"benchtool bench check {device.address} --rig pquad"
    page.locator(".command-text", has_text=command).wait_for()
    page.get_by_text("0 lost, 0 corrupt").first.wait_for()
    # Invalid or too large numbers drive no motor.
    pulse = page.get_by_role("spinbutton", name="Pulse, us")
    for typed, accepted in (("99999", "1950"), ("abc", "")):
        pulse.fill("")
        pulse.press_sequentially(typed)
        pulse.press("Tab")
        expect(pulse).to_have_value(accepted)
    expect(page.locator(".q-notification__message")).to_have_count(0)
    assert device.turning_us() <= 1000.0


def test_motors_turn_while_the_button_is_held_and_keys_stop_them(page, device):
    connect(page, device.address)
    # The field loses the focus to the button with the first press.
    page.get_by_role("spinbutton", name="Pulse, us").click()
    hold(page, device, presses=1)
    released = time.time()
    page.mouse.up()
    assert device.stopped_after(released) < STOPPED_S
    for key in ("Escape", " "):
        hold(page, device)
        pressed = time.time()
        page.keyboard.down(key)
        assert device.stopped_after(pressed) < STOPPED_S
        page.get_by_text("stopped from the page").first.wait_for()
        # The held button must not restart the motors.
        page.wait_for_timeout(500)
        assert device.turning_us() == 0.0
        page.keyboard.up(key)
        page.mouse.up()
    # In a text field the space bar types a space; Escape is STOP there too.
    page.get_by_role("button", name="Connection").click()
    field = page.get_by_label("Address of the bench")
    field.fill("a")
    typed = time.time()
    field.press(" ")
    expect(field).to_have_value("a ")
    page.wait_for_timeout(300)
    assert [order for order in device.orders if order[0] > typed] == []
    field.press("Escape")
    assert device.stopped_after(typed) < 2.0


def test_a_page_that_freezes_with_the_throttle_held_lets_go(web, device, browser):
    before = set(psutil.Process().children(recursive=True))
    other = browser.browser_type.launch(
        executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
    )
    processes = set(psutil.Process().children(recursive=True)) - before
    page = other.new_page(viewport={"width": 1280, "height": 900})
    page.goto(web.url)
    connect(page, device.address)
    hold(page, device)
    processes |= set(psutil.Process().children(recursive=True)) - before
    lost = time.time()
    for process in processes:
        process.suspend()
    try:
        assert device.stopped_after(lost) < RELEASE_TIMEOUT_S + STOPPED_S
    finally:
        for process in processes:
            process.resume()
        other.close()


def test_a_page_whose_main_thread_is_blocked_lets_go_and_says_why(page, device):
    connect(page, device.address)
    hold(page, device)
    page.evaluate(
        "() => setTimeout(() => { const end = performance.now() + 3000;"
        " window.blockedAt = Date.now() / 1000; while (performance.now() < end); }, 0)"
    )
    page.wait_for_function("window.blockedAt")
    assert device.stopped_after(page.evaluate("window.blockedAt")) < RELEASE_TIMEOUT_S + STOPPED_S
    page.get_by_text(": the page is too busy").wait_for()
    # The held button must not restart the motors.
    page.wait_for_timeout(500)
    assert device.turning_us() == 0.0
    page.mouse.up()
    hold(page, device)
    blurred = time.time()
    page.evaluate("window.dispatchEvent(new Event('blur'))")
    assert device.stopped_after(blurred) < STOPPED_S
    page.get_by_text("released: the window lost the focus").wait_for()


CLOSE_IS_SEEN_LATE = """
const Plain = window.WebSocket;
window.WebSocket = class extends Plain {
  set onclose(act) { super.onclose = act && ((event) => setTimeout(act, 400, event)); }
};
"""
"""Delays the close event in the main thread, so that the worker receives it first."""


@pytest.mark.parametrize("script", ["", CLOSE_IS_SEEN_LATE], ids=["plain", "worker_first"])
def test_a_server_that_dies_with_the_throttle_held_stops_motors(script, page, web, device):
    page.add_init_script(script)
    page.reload()
    connect(page, device.address)
    hold(page, device)
    killed = time.time()
    web.process.kill()
    assert device.stopped_after(killed) < STOPPED_S
    note = page.locator(".stop-note")
    note.get_by_text("No connection to benchtool since").wait_for()
    # The server may have sent "motors at 1050 us" before its end or not.
    expect(note).to_contain_text("The throttle was held here, at up to 1")
    expect(note).to_contain_text(f"Last known: {device.address}, motors ")
    expect(note).to_contain_text("cut the power")
    expect(page.locator(".q-page-container")).to_have_css("filter", "grayscale(1)")
    page.mouse.up()
    lost = note.get_by_text("STOP did not reach benchtool. Cut the power.")
    for _ in range(40):  # the bench process accepts STOP until it has ended
        page.keyboard.press("Escape")
        page.wait_for_timeout(500)
        if lost.is_visible():
            break
    expect(lost).to_be_visible()


def test_a_server_that_hangs_greys_the_page_until_it_answers_again(page, web):
    web.process.send_signal(signal.SIGSTOP)
    note = page.locator(".stop-note")
    try:
        note.get_by_text("Last known: no bench is connected.").wait_for()
        expect(page.locator("body.server-lost")).to_have_count(1)
    finally:
        web.process.send_signal(signal.SIGCONT)
    note.get_by_text("The connection to benchtool was lost at").wait_for()
    expect(page.locator("body.server-lost")).to_have_count(0)
    assert "was lost at" in note.inner_text()


def test_of_two_pages_one_is_at_the_controls(page, web, device, open_page):
    connect(page, device.address)
    second = open_page(web.url)
    second.get_by_text("watching").wait_for()
    expect(second.get_by_role("button", name="Take over")).to_be_hidden()
    second.get_by_role("button", name="Tare").click()
    second.get_by_text("another page has the control lock").wait_for()
    hold(page, device)
    second.mouse.move(*centre(second.locator(".stop-button")))
    pressed = time.time()
    second.mouse.down()
    assert device.stopped_after(pressed) < STOPPED_S
    page.close()
    second.get_by_role("button", name="Take over").click()
    second.get_by_text("this page controls", exact=True).wait_for()
