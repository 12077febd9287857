"""Live charts of the Bench tab: what is shown, pause and zoom, picture and table, annotations."""

from __future__ import annotations

import csv
import itertools
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from benchtool.data.run.append import read_events
from tests.browser.conftest import Web, connect, expect, go_to, only_run, start

if TYPE_CHECKING:
    from playwright.sync_api import Page


pytestmark = pytest.mark.real_time(deadline_s=0.1)

BENCH = "sim:pquad?rate=100"


def seen_s(page: Page, folder: Path) -> tuple[list[str], list[float]]:
    """Return the columns and times in s of the table of what is seen."""
    with page.expect_download() as download:
        page.get_by_role("button", name="CSV").click()
    path = folder / "seen.csv"
    download.value.save_as(path)
    head, *rows = list(csv.reader(path.read_text("utf-8").splitlines()))
    assert all(float(low) <= float(high) for _, low, high, *_ in rows if low)
    return head, [float(row[0]) for row in rows]


def test_paused_charts_zoom_and_give_what_is_seen(page: Page, tmp_path: Path) -> None:
    connect(page, BENCH)
    page.wait_for_function("Number(document.querySelector('.strips').dataset.frames) > 80")
    page.get_by_role("button", name="Pause").click()
    page.get_by_text("Nothing is lost meanwhile").wait_for()
    columns, whole_s = seen_s(page, tmp_path)
    measured = ("thrust_N", "torque_Nm", "temperature_degC", "plate_tilt_deg", "plate_x_m")
    assert {f"{name}_least" for name in measured} < set(columns)
    assert len(whole_s) > 40
    strips = page.locator(".strips")
    strips.hover(position={"x": 400, "y": 60})
    page.mouse.wheel(0, -400)
    page.wait_for_timeout(300)
    _, part_s = seen_s(page, tmp_path)
    assert whole_s[0] < part_s[0] < part_s[-1] < whole_s[-1] or len(part_s) < len(whole_s)
    # The crosshair names what it crosses.
    strips.hover(position={"x": 500, "y": 60})
    expect(strips).to_contain_text("Plate tilt: 0.00 deg")
    with page.expect_download() as download:
        page.get_by_role("button", name="PNG").click()
    download.value.save_as(tmp_path / "seen.png")
    assert (tmp_path / "seen.png").read_bytes()[:4] == b"\x89PNG"
    page.get_by_role("combobox", name="Charts").click()
    page.get_by_role("option", name="Torque").click()
    page.keyboard.press("Tab")
    page.get_by_role("button", name="Live").click()
    page.wait_for_timeout(300)
    columns, live_s = seen_s(page, tmp_path)
    assert "torque_Nm_least" not in columns
    # What came while the charts stood still is there, too.
    gaps_s = [later - earlier for earlier, later in itertools.pairwise(live_s)]
    assert live_s[-1] > whole_s[-1] + 0.5
    assert max(gaps_s) < 0.5


def test_an_annotation_goes_into_the_run(page: Page, web: Web) -> None:
    connect(page, BENCH)
    expect(page.get_by_label("Annotation for the run")).to_be_hidden()
    start(page, repeats=1, distances="1")
    page.get_by_text("running: ").wait_for()
    go_to(page, "Bench")
    page.get_by_label("Annotation for the run").fill("a door was opened")
    page.get_by_role("button", name="Annotate").click()
    page.wait_for_function(
        "Array.from(document.querySelectorAll('.strips')).some((one) => one.dataset.marks === '1')"
    )
    page.keyboard.press("Escape")
    go_to(page, "Sweep")
    page.get_by_text("stopped: ").first.wait_for()
    events = read_events(only_run(web).path / "events.jsonl")
    (noted,) = [event for event in events if event.event == "annotation"]
    assert noted.text == "a door was opened"
    assert noted.time_s > 0.0
