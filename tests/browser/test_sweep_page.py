from __future__ import annotations

import re
import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

from benchtool.data.run.read import read_points
from tests.browser.conftest import (
    SWEEP_MS,
    Web,
    begin,
    centre,
    connect,
    expect,
    go_to,
    only_run,
    wait_for_points,
)
from tests.browser.device import Device, served_device

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.real_time(deadline_s=0.1)


@pytest.mark.parametrize("needs_page", [True, False])
def test_a_sweep_goes_to_its_end_also_when_the_page_is_loaded_again(
    needs_page: bool, page: Page, web: Web, fast_device: Device
) -> None:
    begin(page, fast_device, repeats=2, needs_page=needs_page)
    wait_for_points(page, 1)
    page.reload()
    page.get_by_text("at the controls", exact=True).wait_for()
    if needs_page:
        page.get_by_role("button", name="Continue", exact=True).click()
    run = only_run(web)
    page.get_by_text(f"ended: {run.path}").wait_for(timeout=SWEEP_MS)
    page.get_by_text("points, 0 not settled").wait_for()
    page.locator(".ratio-plot .scatterlayer .point").first.wait_for()
    run = only_run(web)
    assert run.metadata["state"] == "ended"
    assert run.metadata["link"]["lost"] == 0
    assert run.metadata["samples"]["parquet_sha256"]
    assert run.metadata["needs_page"] is needs_page
    points = read_points(run.path)
    assert set(points.column("plate_z_m").round(3)) == {0.072, 0.12, 1.4}
    assert fast_device.turning_us() <= 1000.0


def test_stop_in_mid_sweep_and_go_on_later(page: Page, web: Web, fast_device: Device) -> None:
    begin(page, fast_device, repeats=2)
    wait_for_points(page, 2)
    page.mouse.move(*centre(page.locator(".stop-button")))
    pressed = time.time()
    page.mouse.down()
    assert fast_device.stopped_after(pressed) < 0.3
    page.mouse.up()
    page.get_by_text("stopped: ").first.wait_for()
    orders = [order for order in fast_device.orders if order[0] > pressed + 0.5]
    assert max((highest for _, _, highest in orders), default=0.0) <= 1000.0
    run = only_run(web)
    assert run.metadata["state"] == "stopped"
    assert "stopped from the page" in run.metadata["reason"]
    done = len(read_points(run.path))
    page.get_by_role("button", name="Resume a stopped run").click()
    page.get_by_role("dialog").get_by_role("button", name="Resume").click()
    page.get_by_role("button", name="Start", exact=True).click()
    page.get_by_text(f"ended: {run.path}").wait_for(timeout=SWEEP_MS)
    points = read_points(run.path)
    assert len(points) > done >= 2
    assert points.column("point").tolist() == [float(i + 1) for i in range(len(points))]
    assert run.metadata["state"] == "ended"


def test_a_paused_sweep_stands_still_and_goes_on(
    page: Page, web: Web, fast_device: Device, open_page: Callable[[str], Page]
) -> None:
    begin(page, fast_device, repeats=2, distances="1")
    wait_for_points(page, 1)
    page.get_by_role("button", name="Pause").click()
    page.get_by_text("paused: ").first.wait_for(timeout=SWEEP_MS)
    assert fast_device.turning_us() <= 1000.0
    # Another page sees the same.
    second = open_page(f"{web.url}?tab=sweep")
    second.get_by_text("paused: ").first.wait_for()
    page.get_by_role("button", name="Continue", exact=True).click()
    page.get_by_text(f"ended: {only_run(web).path}").wait_for(timeout=SWEEP_MS)
    assert only_run(web).metadata["state"] == "ended"


def test_the_arming_dialog_names_what_the_bench_does_not_protect_from(page: Page) -> None:
    with served_device(version=1) as device:
        connect(page, device.address)
        warning = page.get_by_text(
            "Warning: the device speaks protocol version 1 and is unprotected"
        )
        warning.wait_for()  # beside the throttle
        go_to(page, "Sweep")
        page.get_by_label("Pulses, us").fill("1500")
        page.get_by_role("button", name="Start the sweep").click()
        page.get_by_text("About to spin").wait_for()
        page.get_by_role("dialog").locator(warning).wait_for()
        assert "unprotected" in page.get_by_role("dialog").inner_text()
        page.get_by_role("button", name="Cancel").click()


def test_a_plan_that_breaks_a_limit_is_refused_before_anything_spins(page: Page) -> None:
    connect(page, "sim:pquad")
    go_to(page, "Sweep")
    # What runs when a field is empty stands in it.
    field = page.get_by_label("Plate distances, z/R")
    expect(field).to_have_attribute("placeholder", re.compile("^empty: [0-9.,]+$"))
    distances = (field.get_attribute("placeholder") or "").removeprefix("empty: ")
    facts = page.locator(".facts-grid").locator("visible=true").first
    expect(facts).to_contain_text(distances.replace(",", ", "))
    expect(page.get_by_label("Repeats")).to_have_attribute("placeholder", "empty: 5")
    page.get_by_label("Pulses, us").fill("1400,1999")
    page.get_by_text("throttle.pwm_us names 1999 us, allowed are").wait_for()
    page.locator("button:disabled", has_text="Start the sweep").wait_for()
    page.get_by_label("Pulses, us").fill("1400,x")
    page.get_by_text("Pulses, us is '1400,x', but numbers between commas are needed").wait_for()
    page.get_by_label("Pulses, us").fill("1400")
    page.locator("button:enabled", has_text="Start the sweep").wait_for()
    page.get_by_text("limits hold").wait_for()
    assert "1400 us" in facts.inner_text()


def test_a_test_without_a_plate_shows_no_fields_of_one(page: Page) -> None:
    connect(page, "sim:pquad_single")
    go_to(page, "Sweep")
    distances = page.get_by_label("Plate distances, z/R")
    expect(distances).to_be_visible()
    page.get_by_label("Test", exact=True).click()
    page.get_by_role("option", name="steps").click()
    page.get_by_text("no plate: throttle alone").wait_for()
    expect(distances).to_be_hidden()
    expect(page.get_by_label("Order", exact=True)).to_have_value("counterbalanced")
    assert "references" not in page.locator(".facts-grid").first.inner_text()
