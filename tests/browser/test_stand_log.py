"""A stand's log on the page: uploaded with its propeller, its thrust curve, an autopilot's file."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

import benchtool as bt
from tests.browser.conftest import Web, expect
from tests.unit.fit.test_motor_logs import log

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.real_time(deadline_s=0.1)

COLD_MS = 90_000


def test_a_log_gives_its_thrust_curve_and_a_file_for_an_autopilot(
    web: Web, open_page: Callable[[str], Page]
) -> None:
    written = log(web.runs.parent / "stand.csv", 1)
    page = open_page(f"{web.url}?tab=runs")
    page.get_by_text("Import a table or log").click()
    page.get_by_label("Propeller").fill("5x4")
    page.wait_for_timeout(600)  # the field waits for the next letter
    page.locator("input[type=file]").set_input_files(written)
    page.locator(".card-title", has_text="stand").wait_for(timeout=COLD_MS)
    page.get_by_text("Thrust curve and motor constants").click()
    page.get_by_text(re.compile("12 points of 1 run on rig stand: a rotor gave")).wait_for(
        timeout=COLD_MS
    )
    expect(page.get_by_role("img", name=re.compile("Thrust of one rotor"))).to_be_visible()
    with page.expect_download(timeout=COLD_MS) as taken:
        page.get_by_role("button", name="Export").click()
    text = taken.value.path().read_text("utf-8")
    (file,) = bt.export(written, "ardupilot", web.runs.parent / "a.param", propeller="5x4")

    def numbers(lines: str) -> list[str]:
        return [line for line in lines.splitlines() if not line.startswith("#")]

    assert numbers(text) == numbers(file.read_text("utf-8"))
    assert taken.value.suggested_filename == "stand.param"
