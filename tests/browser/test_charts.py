"""Live charts of the Bench tab: selection, pause and zoom, image and table, live recording."""

from __future__ import annotations

import csv
import itertools
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.browser.conftest import connect, expect, only_run
from tests.browser.test_bench_page import STOPPED_S, hold

if TYPE_CHECKING:
    from playwright.sync_api import Page


pytestmark = pytest.mark.real_time(deadline_s=0.1)

BENCH = "sim:pquad?rate=100"


def save_table(page: Page, folder: Path) -> tuple[list[str], list[float]]:
    """Save the table of the visible frames; return its columns and times in s."""
    with page.expect_download() as download:
        page.get_by_role("button", name="CSV").click()
    path = folder / "live.csv"
    download.value.save_as(path)
    header, *rows = list(csv.reader(path.read_text("utf-8").splitlines()))
    assert all(float(low) <= float(high) for _, low, high, *_ in rows if low)
    return header, [float(row[0]) for row in rows]


def test_paused_charts_zoom_and_give_what_is_seen(page, tmp_path):
    connect(page, BENCH)
    page.wait_for_function("Number(document.querySelector('.strips').dataset.frames) > 80")
    page.get_by_role("button", name="Pause").click()
    page.get_by_text("No data are lost").wait_for()
    columns, whole_s = save_table(page, tmp_path)
    measured = ("thrust_N", "torque_Nm", "temperature_degC", "plate_tilt_deg", "plate_x_m")
    assert {f"{name}_least" for name in measured} < set(columns)
    assert len(whole_s) > 40
    strips = page.locator(".strips")
    strips.hover(position={"x": 300, "y": 60})
    page.mouse.wheel(0, -400)
    page.wait_for_timeout(300)
    _, part_s = save_table(page, tmp_path)
    assert whole_s[0] < part_s[0] < part_s[-1] < whole_s[-1] or len(part_s) < len(whole_s)
    # The tooltip shows the values at the crosshair.
    strips.hover(position={"x": 500, "y": 60})
    expect(strips).to_contain_text("Plate tilt: 0.00 deg")
    with page.expect_download() as download:
        page.get_by_role("button", name="PNG").click()
    download.value.save_as(tmp_path / "live.png")
    assert (tmp_path / "live.png").read_bytes()[:4] == b"\x89PNG"
    page.get_by_role("combobox", name="Charts").click()
    page.get_by_role("option", name="Torque").click()
    page.keyboard.press("Tab")
    page.get_by_role("button", name="Live").click()
    page.wait_for_timeout(300)
    columns, live_s = save_table(page, tmp_path)
    assert "torque_Nm_least" not in columns
    # Frames received during the pause are included.
    gaps_s = [later - earlier for earlier, later in itertools.pairwise(live_s)]
    assert live_s[-1] > whole_s[-1] + 0.5
    assert max(gaps_s) < 0.5


def test_stop_ends_a_live_recording_with_motors_at_zero(page, web, device):
    connect(page, device.address)
    page.get_by_role("button", name="Record", exact=True).click()
    page.get_by_role("button", name="End", exact=True).wait_for()
    page.wait_for_timeout(3000)  # the tare
    hold(page, device)
    pressed = time.time()
    page.keyboard.press("Escape")
    assert device.stopped_after(pressed) < STOPPED_S
    page.get_by_text("stopped: ").first.wait_for()
    page.mouse.up()
    run = only_run(web)
    assert run.metadata["state"] == "stopped"
    assert "stopped from the page" in run.metadata["reason"]
    # The bench is still connected and accepts manual throttle.
    hold(page, device)
    page.mouse.up()
