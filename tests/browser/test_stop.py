"""STOP during drags and with menus, dialogs and notifications above the page.

A finger holds the throttle, so the device is above zero throttle when STOP is pressed.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

import pytest

from benchtool.acquire.bench_check import low_throttle_us
from benchtool.core.rig_file import load_rig_by_name
from benchtool.web.bench_process.throttle import RELEASE_TIMEOUT_S
from tests.browser.conftest import centre, connect, expect, go_to
from tests.browser.hands import STOPPED_S, Hands, click, drag, visible

if TYPE_CHECKING:
    from playwright.sync_api import Page


EMPTY_POSITION = (640.0, 890.0)  # no element there


@pytest.fixture
def hands(page, device):
    """Return input on a page that is connected to a device."""
    connect(page, device.address)
    return Hands(page, device)


def test_the_slider_sets_the_pulse_and_stop_works_while_it_is_dragged(page, device, hands):
    pulse = page.get_by_role("spinbutton", name="Pulse, us")
    slider = page.locator(".q-slider[aria-label=Pulse], .q-slider").first
    x, y = centre(slider)
    low_us = low_throttle_us(load_rig_by_name("pquad"))
    expect(pulse).to_have_value(f"{low_us:.0f}")
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 5.0, y)
    page.wait_for_function(
        "low => Number(document.querySelector('[type=number][aria-label^=Pulse]').value)"
        " > low + 100",
        arg=low_us,
    )
    page.mouse.move(x - 60.0, y)
    moved = "[type=number][aria-label^=Pulse]"
    page.wait_for_function(f"Number(document.querySelector('{moved}').value) < 1450")
    # During a drag, no element receives pointer events.
    for way in ("second mouse button", "Escape"):
        pressed = hands.stop_by(way)
        assert device.stopped_after(pressed) < STOPPED_S
        hands.let_go()
        page.mouse.move(x - 60.0, y)
        page.mouse.down()
        page.mouse.move(x - 62.0, y)
    page.mouse.up()
    # The move to STOP dragged the slider; wait until the last move is processed.
    slid = "Number(document.querySelector('[role=slider][aria-label=Pulse]').ariaValueNow)"
    page.wait_for_function(f"1050 < {slid} && {slid} < 1450")
    slider_us = page.get_by_role("slider", name="Pulse").get_attribute("aria-valuenow")
    assert slider_us is not None
    expect(pulse).to_have_value(slider_us)
    target_us = float(slider_us)
    for way in ("mouse", "touch", "Escape"):
        with hands.turning():
            device.wait_for_us(target_us)
            hands.stops(way)


def test_a_key_that_stops_says_so_and_does_nothing_else(page, device, hands):
    note = page.locator(".stop-note")
    box = page.get_by_role("checkbox").first
    box.focus()
    before = box.get_attribute("aria-checked")
    pressed = time.time()
    page.keyboard.press(" ")
    assert device.stopped_after(pressed) < STOPPED_S
    note.get_by_text("The space bar is STOP outside text fields").wait_for()
    assert before is not None
    expect(box).to_have_attribute("aria-checked", before)
    # In a number field the space bar is STOP.
    page.get_by_role("spinbutton", name="Pulse, us").focus()
    pressed = time.time()
    page.keyboard.press(" ")
    assert device.stopped_after(pressed) < STOPPED_S
    page.get_by_role("button", name="Connection").click()
    page.get_by_role("button", name="Find").click()
    page.get_by_text("simulated at 1 kHz").first.wait_for()
    pressed = time.time()
    page.keyboard.press("Escape")
    assert device.stopped_after(pressed) < STOPPED_S
    note.get_by_text("Esc is STOP everywhere").wait_for()
    page.wait_for_timeout(300)
    expect(page.get_by_text("simulated at 1 kHz").first).to_be_visible()


def test_no_tab_keeps_stop_waiting_or_logs_an_error_when_it_is_first_shown(page):
    errors = []
    page.on("console", lambda message: errors.append(message) if message.type == "error" else None)
    page.evaluate(
        "() => { window.blocked = [0]; new PerformanceObserver((list) => list.getEntries()"
        ".forEach((task) => window.blocked.push(task.duration))).observe({ type: 'longtask' }); }"
    )
    for tab in TABS:
        go_to(page, tab)
        if tab == "Sweep":
            page.locator(".ratio-plot canvas").first.wait_for()
        page.wait_for_timeout(1000)
        assert page.evaluate("Math.max(...window.blocked)") < 1e3 * RELEASE_TIMEOUT_S, tab
        assert [error.text for error in errors] == [], tab


TABS = {"Bench": 2, "Sweep": 3, "Runs": 1, "Fit": 4, "Simulate": 4, "Explain": 3}
"""Tabs with their minimum number of lists and sliders."""


def overlays(page: Page) -> Iterator[tuple[str, Callable[[], None]]]:
    """Yield the name of each overlay or draggable element and a function that activates it."""
    for tab, count in TABS.items():
        before = page.query_selector_all(".q-select:visible") if tab != "Bench" else []
        go_to(page, tab)
        for element in before:
            element.wait_for_element_state("hidden")
        # NiceGUI builds a tab when first shown.
        page.wait_for_function(
            "count => [...document.querySelectorAll('.q-select, .q-slider')]"
            ".filter((each) => each.checkVisibility()).length >= count",
            arg=count,
        )
        for number, select in enumerate(visible(page, ".q-select")):
            yield f"{tab}: list {number}", lambda select=select: click(select)
        for number, slider in enumerate(visible(page, ".q-slider")):
            yield f"{tab}: slider {number}", lambda slider=slider: drag(page, slider)
        if tab == "Bench":
            click(page.get_by_role("button", name="Connection"))
            find = page.get_by_role("button", name="Find")
            yield "Bench: menu", lambda find=find: click(find)
            page.get_by_label("Plate distance, mm", exact=True).fill("")
            move = page.get_by_role("button", name="Move")
            yield "Bench: notes", lambda move=move: [click(move) for _ in range(12)] and None
        elif tab == "Sweep":
            for name in ("Start the sweep", "Resume a stopped run"):
                button = page.get_by_role("button", name=name)
                yield f"Sweep: dialog {name}", lambda button=button: click(button)


WAYS = ("touch", "mouse", "Escape")


def test_stop_works_over_every_list_menu_dialog_note_and_dragged_slider(page, web, device, hands):
    stopped = web.runs / "stopped"
    stopped.mkdir(parents=True)
    (stopped / "metadata.json").write_text('{"state": "stopped"}', "utf-8")
    (stopped / "plan.toml").write_text("", "utf-8")
    names = []
    for number, (name, activate) in enumerate(overlays(page)):
        ways = WAYS[number % 3 :] + WAYS[: number % 3]
        tab = name.partition(":")[0]
        if tab == "Bench" or "dialog" in name:
            go_to(page, "Bench")
            with hands.turning():
                click(page.get_by_role("tab", name=tab))
                activate()
                page.wait_for_timeout(250)
                for way in ways:
                    hands.stops(way)
        else:
            activate()
            page.wait_for_timeout(250)
            hands.stops(ways[0])
            hands.let_go()
        names.append(name)
        # A click outside a dialog also closes it, so press its button first.
        for dialog in visible(page, ".q-dialog"):
            dialog.get_by_role("button", name="Cancel").click()
        page.mouse.click(*EMPTY_POSITION)
    assert len(names) >= 20, names
    for kind in ("list", "slider", "menu", "notes", "dialog"):
        assert any(kind in name for name in names)
