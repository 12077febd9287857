"""Runs and Fit tabs: search, view, download and fit, limited to the runs folder."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
import pytest

from tests.browser.conftest import expect, serving

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.real_time(deadline_s=0.1)

TOP = Path(__file__).parents[2]

COLD_MS = 90_000  # start of a process with the plot libraries on a busy machine

STAND = "rcbenchmark_1580/StepsTest_2020-05-22_102946.csv"
REPORT = "<!doctype html><title>Fit: earlier</title>"

Opens = Callable[[str], "Page"]


@pytest.fixture(scope="module")
def filled(browser, tmp_path_factory):
    """Return a server with two sweeps, a fit and a broken run."""
    runs = tmp_path_factory.mktemp("page") / "runs"
    for name in ("quad", "single_rotor"):
        shutil.copytree(TOP / "datasets" / name / "run", runs / name)
    shutil.copytree(TOP / "fits" / "quad", runs / "earlier")
    (runs / "earlier" / "report.html").write_text(REPORT, "utf-8")
    shutil.copytree(runs / "quad", runs / "broken")
    (runs / "broken" / "metadata.json").write_text("{", "utf-8")
    (runs.parent / "secret.csv").write_text("thrust_N\n1\n", "utf-8")
    with serving(runs, runs.parent / "state") as web:
        yield web


def wait_for_controls(page: Page) -> None:
    """Wait until the page of an earlier test has released the control lock."""
    take = page.get_by_role("button", name="Take over")
    take.or_(page.get_by_text("this page controls", exact=True)).first.wait_for()


def test_a_run_is_found_and_shows_its_numbers(filled, open_page):
    page = open_page(f"{filled.url}?tab=runs")
    page.get_by_text("4 in runs, 1 not readable").wait_for()
    names = page.locator(".run-name")
    expect(names).to_have_count(4)
    assert set(names.all_inner_texts()) == {"quad", "single_rotor", "earlier", "broken"}
    expect(page.locator(".summary.problem")).to_contain_text("this is not valid JSON")
    page.get_by_label("Search name, rig, date, state, note").fill("sweep pquad_single")
    page.get_by_text("1 of 4 in runs").wait_for()
    expect(names).to_have_text(["single_rotor"])
    page.get_by_role("button", name="single_rotor").click()
    page.get_by_text("1.2343 ± 0.0016").first.wait_for(timeout=COLD_MS)
    expect(page.get_by_role("img", name=re.compile("Thrust near the plate"))).to_be_visible()
    expect(page.locator(".command-text").last).to_contain_text("benchtool report")
    with page.expect_download(timeout=COLD_MS) as download:
        page.get_by_role("button", name="points, CSV").click()
    expected = filled.runs / "single_rotor" / "points.csv"
    assert download.value.suggested_filename == "single_rotor-points.csv"
    # The points of the run, followed by derived quantities.
    table, run = (pd.read_csv(path) for path in (download.value.path(), expected))
    pd.testing.assert_frame_equal(table[run.columns], run, check_dtype=False)
    page.get_by_label("Search name, rig, date, state, note").fill("fit")
    page.get_by_role("button", name="earlier").click()
    page.get_by_role("row", name=re.compile("^body_lift.K_b – 1.892 ± 0.022")).first.wait_for()
    with page.expect_download(timeout=COLD_MS) as report:
        page.get_by_role("button", name="Report, HTML").click()
    assert Path(report.value.path()).read_text("utf-8") == REPORT
    # A pending report is downloaded even if another entry is opened meanwhile.
    page.get_by_label("Search name, rig, date, state, note").fill("")
    page.get_by_role("button", name="single_rotor").click()
    page.get_by_text("1.2343 ± 0.0016").first.wait_for(timeout=COLD_MS)
    with page.expect_download(timeout=COLD_MS) as pending:
        page.get_by_role("button", name="Report, HTML").click()
        page.get_by_role("button", name="earlier").click()
    assert pending.value.suggested_filename == "single_rotor-report.html"


def test_a_fit_gives_the_numbers_of_the_command(filled, open_page):
    page = open_page(f"{filled.url}?tab=fit&data=quad")
    page.get_by_label("body_lift.K_b is free").wait_for()
    wait_for_controls(page)
    name = page.get_by_label("Name of the fit's folder")
    for invalid_name, reason in (("../evil", "cannot name a run"), ("quad", "quad exists already")):
        name.fill(invalid_name)
        page.locator(".command-text", has_text=invalid_name).wait_for()
        page.get_by_role("button", name="Fit", exact=True).click()
        page.locator(".q-notification__message", has_text=reason).wait_for()
    name.fill("fit-here")
    command = page.locator(".command-text", has_text="fit-here")
    command.wait_for()
    arguments = shlex.split(command.inner_text())
    page.get_by_label("neighbour_images.strength is fixed at").fill("0.9")
    page.locator(".command-text", has_text="--fix neighbour_images.strength=0.9").wait_for()
    page.get_by_label("neighbour_images.strength is fixed at").fill("1")
    page.locator(".command-text", has_text=re.compile("^((?!--fix).)*$")).first.wait_for()
    page.get_by_role("button", name="Fit", exact=True).click()
    row = page.locator(".shown-body").get_by_role("row", name=re.compile("^body_lift.K_b"))
    row.wait_for(timeout=COLD_MS)
    cells = row.locator("td").all_inner_texts()
    assert (arguments[0], arguments[-2:]) == ("benchtool", ["--out", str(filled.runs / "fit-here")])
    printed = subprocess.run(
        [sys.executable, "-m", "benchtool", *arguments[1:-2]],
        capture_output=True,
        encoding="utf-8",
        check=True,
    ).stdout
    line = next(text for text in printed.splitlines() if text.strip().startswith("body_lift.K_b"))
    words = ["body_lift.K_b", *" ".join(cells).split()]
    assert line.split()[: len(words)] == words
    files = {path.name for path in (filled.runs / "fit-here").iterdir()}
    assert {"result.json", "model.toml", "report.html", "ratio.svg"} <= files
    assert not (filled.runs.parent / "evil").exists()


def test_a_stands_log_leads_to_its_motor_constants(filled, open_page, reference_data):
    page = open_page(f"{filled.url}?tab=fit&data=quad")
    page.get_by_label("body_lift.K_b is free").wait_for()
    wait_for_controls(page)
    page.locator("input[type=file]").set_input_files(reference_data / STAND)
    page.get_by_text("The log names no propeller").wait_for(timeout=COLD_MS)
    page.get_by_label("Propeller, if the log names none").fill("5x4.5")
    page.get_by_role("button", name="Motor constants").click()
    page.get_by_text("Thrust of one rotor over throttle").wait_for(timeout=COLD_MS)
    page.get_by_role("button", name="Compare", exact=True).last.click()
    page.get_by_text("is selected; select others").wait_for()
    expect(page.get_by_role("checkbox", name=re.compile("Choose .*StepsTest"))).to_be_checked()
