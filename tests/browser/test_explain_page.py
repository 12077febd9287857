"""Explain tab: a hidden effect is identified and accepted into a model."""

from __future__ import annotations

import shutil
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from benchtool.data.run.recording_file import write_recording
from benchtool.report.flight.pitch_study import pitch_study
from benchtool.simulate.inputs import PitchInputs
from benchtool.simulate.pitch.setup import pitch_setup
from tests.browser.conftest import expect, serving

if TYPE_CHECKING:
    from playwright.sync_api import Page

EXPLAINS_MS = 150_000
MODEL = str(Path(__file__).parents[2] / "datasets/pitch_bench/model.toml")


def write_example(path: Path, duration_s: float, seed: int) -> None:
    """Write a recording of a bench with hinge friction, which its model lacks."""
    inputs = PitchInputs(model=MODEL, controllers=("pid",), schedule="identify")
    setup = pitch_setup(inputs, "stiff").with_changes({"coulomb_friction.torque_Nm": 0.012})
    setup = replace(setup, schedule=setup.schedule.with_duration(duration_s))
    run = pitch_study(setup, seed).runs[0]
    write_recording(path, run.recording(setup.bench.model.rig), {})


@pytest.fixture
def lab(browser, tmp_path):
    """Return a server with two recordings and a model."""
    bench = tmp_path / "runs" / "bench"
    bench.mkdir(parents=True)
    write_example(bench / "learn.csv", 10.0, seed=21)
    write_example(bench / "check.csv", 8.0, seed=22)
    shutil.copy(MODEL, bench / "model.toml")
    (bench / "odd.csv").write_text("a,b\n1,2\n3,4\n")
    with serving(tmp_path / "runs", tmp_path / "state") as web:
        yield web


def choose(page: Page, label: str, name: str) -> None:
    page.get_by_label(label, exact=True).click()
    page.keyboard.type(name)
    page.get_by_role("option", name=name).first.click()
    page.keyboard.press("Tab")
    # A list that is still closing would receive the next input.
    expect(page.get_by_role("option")).to_have_count(0)


@pytest.mark.timeout(400)
def test_a_hidden_effect_is_named_accepted_and_found_again(lab, open_page):
    page = open_page(f"{lab.url}?tab=explain")
    explain = page.get_by_role("button", name="Explain", exact=True)
    page.get_by_text("no training recording is selected").wait_for()
    choose(page, "Training recordings", "bench/odd.csv")
    choose(page, "Validation recordings", "bench/odd.csv")
    page.get_by_text("is selected for both training and validation").wait_for()
    page.get_by_label("Remove").last.click()
    choose(page, "Validation recordings", "bench/check.csv")
    choose(page, "Model", "bench/model.toml")
    explain.click()
    alert = page.get_by_role("alert").filter(has_text="odd.csv")
    alert.wait_for(timeout=EXPLAINS_MS)
    expect(alert).to_contain_text("its columns are a, b")

    page.get_by_label("Remove").first.click()
    choose(page, "Training recordings", "bench/learn.csv")
    page.get_by_text("benchtool explain").wait_for()
    explain.click()
    page.locator(".stages li").first.wait_for(timeout=EXPLAINS_MS)
    verdict = page.get_by_text("The model lacks Coulomb friction").first
    verdict.wait_for(timeout=EXPLAINS_MS)
    for heading in ("Which", "The gap"):
        expect(page.get_by_text(heading, exact=True)).to_be_visible()
    expect(page.locator("figure.shown img").nth(4)).to_be_attached()

    page.get_by_role("button", name="Accept coulomb_friction into a new model").click()
    page.get_by_text("was written to").wait_for()
    (folder,) = lab.runs.glob("*explain-learn")
    model = tomllib.loads((folder / "model.toml").read_text())
    assert model["model"]["name"] == "pitch_bench_coulomb_friction"
    assert (folder / "report.html").is_file()
    expect(page.get_by_role("button", name="Accept")).to_be_disabled()

    page.reload()
    page.get_by_text("was written to").wait_for()
    page.get_by_role("button", name="Inputs").click()
    page.get_by_label("Model", exact=True).click()
    page.get_by_role("option", name="explain-learn").wait_for()
