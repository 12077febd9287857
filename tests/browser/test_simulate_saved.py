"""A simulated bench that hides an effect is saved twice, and can then be explained."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

from tests.browser.conftest import Web, expect

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.real_time(deadline_s=0.1)

COMPILES_MS = 150_000
"""The first simulation of a machine compiles."""


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
