from __future__ import annotations

import time

import pytest

from benchtool.data.columns import word_to_code
from benchtool.data.run.read import read_points
from tests.browser.conftest import (
    SWEEP_MS,
    begin,
    centre,
    connect,
    go_to,
    only_run,
    wait_for_points,
)
from tests.browser.device import served_device

pytestmark = pytest.mark.real_time(deadline_s=0.1)


@pytest.mark.parametrize("needs_page", [True, False])
def test_a_sweep_goes_to_its_end_also_when_the_page_is_loaded_again(
    needs_page, page, web, fast_device
):
    begin(page, fast_device, repeats=2, needs_page=needs_page)
    wait_for_points(page, 1)
    page.reload()
    page.get_by_text("this page controls", exact=True).wait_for()
    if needs_page:
        page.get_by_role("button", name="Continue", exact=True).click()
    run = only_run(web)
    page.get_by_text(f"ended: {run.path}").wait_for(timeout=SWEEP_MS)
    page.get_by_text("points, 0 not settled").wait_for()
    run = only_run(web)
    assert run.metadata["state"] == "ended"
    assert run.metadata["link"]["lost"] == 0
    assert run.metadata["samples"]["parquet_sha256"]
    assert run.metadata["needs_page"] is needs_page
    points = read_points(run.path)
    n_ratios = int((points.column("kind") == word_to_code("kind", "measure")).sum())
    page.get_by_role("img", name=f"Thrust, {n_ratios} measured points").wait_for()
    assert set(points.column("plate_z_m").round(3)) == {0.072, 0.12, 1.4}
    assert fast_device.turning_us() <= 1000.0


def test_stop_in_mid_sweep_and_go_on_later(page, web, fast_device):
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
    n_measured = len(read_points(run.path))
    page.get_by_role("button", name="Resume a stopped run").click()
    page.get_by_role("dialog").get_by_role("button", name="Resume").click()
    page.get_by_role("button", name="Start", exact=True).click()
    page.get_by_text(f"ended: {run.path}").wait_for(timeout=SWEEP_MS)
    points = read_points(run.path)
    assert len(points) > n_measured >= 2
    assert points.column("point").tolist() == [float(i + 1) for i in range(len(points))]
    assert run.metadata["state"] == "ended"


def test_the_arming_dialog_names_what_the_bench_does_not_protect_from(page):
    with served_device(warning="a late order may turn its motors") as device:
        connect(page, device.address)
        warning = page.get_by_text("Warning: a late order may turn its motors")
        warning.wait_for()  # next to the throttle
        go_to(page, "Sweep")
        page.get_by_label("Pulses, us").fill("1500")
        page.get_by_role("button", name="Start the sweep").click()
        page.get_by_text("Motors will turn").wait_for()
        page.get_by_role("dialog").locator(warning).wait_for()
        assert "late order" in page.get_by_role("dialog").inner_text()
        page.get_by_role("button", name="Cancel").click()
