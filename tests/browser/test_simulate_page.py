"""Simulate tab: form, simulation, report and transfer to Explain."""

from __future__ import annotations

import re
import shlex
from typing import TYPE_CHECKING

from tests.browser.conftest import expect

if TYPE_CHECKING:
    from playwright.sync_api import Locator, Page

COMPILES_MS = 150_000  # the first simulation of a machine compiles


def choose(page: Page, label: str, option: str) -> None:
    page.get_by_label(label, exact=True).locator("visible=true").click()
    page.get_by_role("option", name=option, exact=True).click()
    page.mouse.click(5.0, 5.0)  # closes a multiple-choice list
    expect(page.get_by_role("option")).to_have_count(0)


def command(page: Page) -> Locator:
    return page.locator(".command-text", has_text="benchtool simulate").first


def test_a_recording_with_a_hidden_effect_goes_to_explain(web, open_page):
    page = open_page(f"{web.url}?tab=simulate")
    choose(page, "Schedule, or its file", "steps")
    choose(page, "Controllers", "pid")
    numbers = page.get_by_label("Numbers, as gains.attitude=1.2").locator("visible=true")
    simulate = page.get_by_role("button", name="Simulate", exact=True)
    numbers.fill("hidden")
    page.get_by_text("write NAME=NUMBER").wait_for()
    expect(simulate).to_be_disabled()
    numbers.fill("no_such.number=1")
    simulate.click()
    expect(page.get_by_role("alert").filter(has_text="no_such.number")).to_be_visible(
        timeout=COMPILES_MS
    )
    assert not list(web.runs.glob("*"))

    numbers.fill("coulomb_friction.torque_Nm=0.0145, gains.attitude=1.1")
    options = "--set coulomb_friction.torque_Nm=0.0145 --set gains.attitude=1.1"
    expect(command(page)).to_contain_text(options)
    arguments = shlex.split(command(page).inner_text())
    simulate.click()
    explain = page.get_by_role("button", name="Explain", exact=True)
    explain.wait_for(timeout=COMPILES_MS)
    expect(page.get_by_text("SIMULATED", exact=True)).to_be_visible()
    expect(page.locator("figure.shown img")).to_be_visible()
    (out,) = web.runs.iterdir()
    assert arguments[arguments.index("--out") + 1] == str(out)
    assert out.joinpath("pid.csv").is_file()

    explain.click()
    page.get_by_text("no validation recording is selected").wait_for()
    expect(page.locator(".q-chip")).to_have_text(re.compile(rf"{out.name}/pid\.csv"))


def test_a_flight_is_found_again_by_a_page_that_is_loaded_anew(web, open_page):
    page = open_page(f"{web.url}?tab=simulate")
    page.get_by_role("button", name="flight", exact=True).click()
    page.get_by_label("Speed limit, m/s").wait_for()
    page.get_by_label("Name of the folder").locator("visible=true").fill("over")
    expect(command(page)).to_contain_text("simulate flight --out")
    page.get_by_role("button", name="Simulate", exact=True).click()
    report = page.locator(".shown-body", has_text="SIMULATED flight over")
    expect(report).to_contain_text("2.73", timeout=COMPILES_MS)
    page.reload()
    report.wait_for()
    assert {"pid.csv", "oge.csv", "flight.svg"} <= {
        path.name for path in (web.runs / "over").iterdir()
    }
