"""Simulate as somebody uses it: look, move a slider, fly, download, save for Explain."""

from __future__ import annotations

import io
import re
import shlex
import signal
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.browser.conftest import Web, expect, serving

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page

pytestmark = pytest.mark.real_time(deadline_s=0.1)

Opens = Callable[[str], "Page"]

COMPILES_MS = 150_000
"""The first simulation of a machine compiles."""


@pytest.fixture(scope="module")
def shared(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Web]:
    """Give one server to all: simulations write nothing."""
    place = tmp_path_factory.mktemp("simulate")
    with serving(place / "runs", place / "state") as web:
        yield web


def opened(shared: Web, open_page: Opens) -> Page:
    page = open_page(f"{shared.url}?tab=simulate")
    page.locator(".side-views[data-drawn]").wait_for(timeout=COMPILES_MS)
    return page


def drawn_again(page: Page, before: str | None) -> str | None:
    page.wait_for_function(
        "before => document.querySelector('.side-views').dataset.drawn !== before",
        arg=before,
        timeout=COMPILES_MS,
    )
    return page.locator(".side-views").get_attribute("data-drawn")


def slider(page: Page, label: str) -> Locator:
    return page.get_by_role("slider", name=label)


def arrow_tip(page: Page) -> str | None:
    return page.locator(".lane").first.locator("[data-rotor='0'] .added").get_attribute("y2")


def command(page: Page) -> Locator:
    return page.locator(".simulate .command-text")


def test_a_slider_redraws_and_the_table_follows(shared: Web, open_page: Opens) -> None:
    page = opened(shared, open_page)
    expect(page.locator(".lane figcaption b")).to_have_text(["pid", "observer", "feedforward"])
    table = page.locator(".simulate-table")
    expect(table).to_contain_text("-1.58")
    page.get_by_role("button", name="Pause").click()
    caption = page.locator(".lane figcaption span").first
    before = caption.inner_text()

    plate = slider(page, "Plate distance z/R [–]")
    plate.locator(".q-slider__track-container").focus()
    for _ in range(4):
        page.keyboard.press("ArrowLeft")
    expect(plate).to_have_attribute("aria-valuenow", "1.8")
    expect(command(page)).to_have_text(re.compile(r"--set plate\.z_over_R=1\.8(\s|$)"))
    expect(page.get_by_text(re.compile(r"z/R = 1\.8(?!\d)"))).to_have_count(3)
    expect(table).not_to_contain_text("-1.58")
    expect(caption).not_to_have_text(before)
    assert "-1.58" not in table.inner_text()


def test_a_slow_server_does_not_set_a_slider_back(shared: Web, open_page: Opens) -> None:
    page = opened(shared, open_page)
    plate = slider(page, "Plate distance z/R [–]")
    plate.locator(".q-slider__track-container").focus()
    shared.process.send_signal(signal.SIGSTOP)
    try:
        for z_over_R in ("1.95", "1.9", "1.85", "1.8"):
            page.keyboard.press("ArrowLeft")
            expect(plate).to_have_attribute("aria-valuenow", z_over_R)
            page.wait_for_timeout(60)  # each step is sent by itself
    finally:
        shared.process.send_signal(signal.SIGCONT)
    # Steps while the answers to the earlier ones come.
    for _ in range(4):
        page.keyboard.press("ArrowLeft")
        page.wait_for_timeout(20)
    expect(command(page)).to_have_text(re.compile(r"--set plate\.z_over_R=1\.6(\s|$)"))
    assert plate.get_attribute("aria-valuenow") == "1.6"


def test_the_picture_moves_with_the_time(shared: Web, open_page: Opens) -> None:
    page = opened(shared, open_page)
    page.get_by_role("button", name="Pause").click()
    time = slider(page, "Time in the run in seconds").locator(".q-slider__track-container")
    box = time.bounding_box()
    assert box is not None
    time.click(position={"x": 0.1 * box["width"], "y": 0.5 * box["height"]})
    clock = page.locator(".side-views-time")
    expect(clock).to_have_text(re.compile(r"^[34]\.\d s"))
    before = arrow_tip(page)
    time.click(position={"x": 0.5 * box["width"], "y": 0.5 * box["height"]})
    expect(clock).to_have_text(re.compile(r"^20\.\d s"))
    over_the_plate = arrow_tip(page)
    assert before is not None
    assert over_the_plate is not None
    assert float(over_the_plate) < float(before)  # upwards is negative in a drawing


def test_flights_stand_side_by_side_and_can_be_taken_home(
    shared: Web, open_page: Opens, tmp_path: Path
) -> None:
    page = opened(shared, open_page)
    drawn = page.locator(".side-views").get_attribute("data-drawn")
    page.get_by_role("button", name="flight", exact=True).click()
    drawn_again(page, drawn)
    page.get_by_text("never arrives: swings 2.73 to 3.15 m").wait_for()
    expect(page.locator(".lane")).to_have_count(3)
    expect(command(page)).to_have_text(re.compile("^benchtool simulate flight "))
    with page.expect_download(timeout=COMPILES_MS) as taken:
        page.get_by_role("button", name="Download CSV").click()
    packed = zipfile.ZipFile(io.BytesIO(Path(taken.value.path()).read_bytes()))
    assert {"pid.csv", "oge.csv", "numbers.txt", "flight.svg"} <= set(packed.namelist())


def test_two_recordings_with_a_hidden_effect_go_to_explain(
    web: Web, open_page: Callable[[str], Page]
) -> None:
    page = open_page(f"{web.url}?tab=simulate")
    page.get_by_label("Schedule").click()
    page.get_by_role("option", name="steps").click()
    for controller in ("observer", "feedforward"):
        chip = page.locator(".q-chip", has_text=controller)
        chip.get_by_label("Remove").click()
        expect(chip).to_have_count(0)
    page.get_by_label("Hidden effect").click()
    page.get_by_role("option", name="Coulomb friction").click()
    page.get_by_role("slider", name="Coulomb friction [N m]").wait_for()
    save = page.get_by_role("button", name="Save to the runs folder")
    command = page.locator(".simulate .command-text", has_text="coulomb_friction.torque_Nm=")
    command.wait_for()
    words = shlex.split(command.inner_text())
    save.click()
    page.get_by_text("save a second one to check on").wait_for(timeout=COMPILES_MS)
    (first,) = web.runs.iterdir()
    assert words[words.index("--out") + 1] == str(first)
    assert first.joinpath("pid.csv").is_file()

    page.get_by_label("Seed of the noise").fill("2")
    save.click()
    page.get_by_text(f"explain {first.name}/pid.csv, checked on {first.name}-2/pid.csv").wait_for()
    page.get_by_role("button", name="Explain", exact=True).click()
    command = page.locator(".command-text", has_text="benchtool explain")
    given = f"{first}/pid.csv --model pitch_pquad --check {first}-2/pid.csv"
    expect(command).to_contain_text(given)
    expect(page.get_by_role("button", name="Explain", exact=True)).to_be_enabled()
