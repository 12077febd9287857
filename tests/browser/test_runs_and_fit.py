"""Runs and Fit as somebody uses them: find, compare, take home, fit, and never leave the folder."""

from __future__ import annotations

import json
import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd
import pytest

from benchtool.data.run.labels import label
from tests.browser.conftest import Web, expect, serving

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.real_time(deadline_s=0.1)

TOP = Path(__file__).parents[2]
LAB = b"gap;F_gf;speed\n60;424.1;5500\n90;362.6;x\n120;342.0;5500\n180;329.9;5500\n"

COLD_MS = 90_000
"""What starts a process and loads the libraries that draw may take so long on a busy machine."""

REPORT = "<!doctype html><title>Fit: earlier</title>"

Opens = Callable[[str], "Page"]


@pytest.fixture(scope="module")
def filled(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Web]:
    """Give a server whose folder holds two sweeps, a fit and a run that broke."""
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
    """Wait until the page of an earlier test has left the controls."""
    take = page.get_by_role("button", name="Take over")
    take.or_(page.get_by_text("at the controls", exact=True)).first.wait_for()


def test_a_run_is_found_and_shows_its_numbers(filled: Web, open_page: Opens) -> None:
    page = open_page(f"{filled.url}?tab=runs")
    page.get_by_text("4 in runs, 1 cannot be read").wait_for()
    names = page.locator(".run-name")
    expect(names).to_have_count(4)
    assert set(names.all_inner_texts()) == {"quad", "single_rotor", "earlier", "broken"}
    expect(page.locator(".summary.problem")).to_contain_text("this is not valid JSON")
    page.get_by_label("Search name, rig, date, state, note").fill("sweep pquad_single")
    page.get_by_text("1 of 4 in runs").wait_for()
    expect(names).to_have_text(["single_rotor"])
    page.get_by_role("button", name="single_rotor").click()
    page.get_by_text("1.2343 ± 0.0016").wait_for(timeout=COLD_MS)
    expect(page.get_by_role("img", name=re.compile("Thrust near the plate"))).to_be_visible()
    expect(page.locator(".command-text").last).to_contain_text("benchtool report")
    with page.expect_download(timeout=COLD_MS) as taken:
        page.get_by_role("button", name="points, CSV").click()
    expected = filled.runs / "single_rotor" / "points.csv"
    assert taken.value.suggested_filename == "single_rotor-points.csv"
    # The points of the run, with quantities that follow from them behind.
    shown, run = (pd.read_csv(path) for path in (taken.value.path(), expected))
    pd.testing.assert_frame_equal(shown[run.columns], run, check_dtype=False)
    page.get_by_label("Search name, rig, date, state, note").fill("fit")
    page.get_by_role("button", name="earlier").click()
    page.get_by_role("row", name=re.compile("^body_lift.K_b – 1.892 ± 0.022")).first.wait_for()
    with page.expect_download(timeout=COLD_MS) as report:
        page.get_by_role("button", name="Report, HTML").click()
    assert Path(report.value.path()).read_text("utf-8") == REPORT
    # A report that is still being made comes, although another entry was opened meanwhile.
    page.get_by_label("Search name, rig, date, state, note").fill("")
    page.get_by_role("button", name="single_rotor").click()
    page.get_by_text("1.2343 ± 0.0016").wait_for(timeout=COLD_MS)
    with page.expect_download(timeout=COLD_MS) as late:
        page.get_by_role("button", name="Report, HTML").click()
        page.get_by_role("button", name="earlier").click()
    assert late.value.suggested_filename == "single_rotor-report.html"


def test_two_sweeps_stand_in_one_plot(filled: Web, open_page: Opens) -> None:
    page = open_page(f"{filled.url}?tab=runs")
    compare = page.get_by_role("button", name="Compare")
    for name in ("quad", "single_rotor"):
        page.get_by_label(f"Choose {name}", exact=True).click()
    page.get_by_role("button", name="Compare 2 sweeps").wait_for()
    compare.click()
    page.get_by_text("2 sweeps compared").wait_for(timeout=COLD_MS)
    page.get_by_role("img", name=re.compile("run by run")).wait_for()
    nearest = page.locator(".shown-body").get_by_role("row", name=re.compile("^0.6 1450 "))
    nearest.wait_for()
    assert all(ratio in nearest.inner_text() for ratio in ("1.2343 ± 0.0016", "1.8081 ± 0.0013"))


def test_runs_are_chosen_by_tags_and_notes(web: Web, open_page: Opens) -> None:
    for name in ("quad", "single_rotor"):
        shutil.copytree(TOP / "datasets" / name / "run", web.runs / name)
    for name in ("first", "second"):
        shutil.copytree(TOP / "fits" / "quad", web.runs / name)
        label(web.runs / name, add=["good", "wide"] if name == "first" else ["good"])
    label(web.runs / "quad", add=["good"], note="a blade has a nick")
    page = open_page(f"{web.url}?tab=runs")
    names = page.locator(".run-name")
    expect(names).to_have_count(4)
    expect(page.get_by_role("row", name=re.compile("quad good"))).to_be_visible()
    page.get_by_label("Tags").click()
    page.get_by_role("option", name="good").click()
    page.get_by_text("3 of 4 in runs").click()  # closes the menu
    assert set(names.all_inner_texts()) == {"quad", "first", "second"}
    for name in ("first", "second"):
        page.get_by_label(f"Choose {name}", exact=True).click()
    page.get_by_role("button", name="Compare 2 fits").click()
    page.get_by_text("2 fits compared").wait_for(timeout=COLD_MS)
    page.locator(".shown-body").get_by_text("body_lift.K_b").first.wait_for()
    page.get_by_label("Search name, rig, date, state, note").fill("nick")
    expect(names).to_have_text(["quad"])
    label(web.runs / "single_rotor", add=["good"], note="nick, too")  # in another program
    expect(names).to_have_count(2)


@pytest.mark.parametrize("name", ["../secret.csv", "quad/../../secret.csv", "%2Fetc%2Fpasswd"])
def test_a_path_outside_the_folder_is_refused(filled: Web, open_page: Opens, name: str) -> None:
    page = open_page(f"{filled.url}?tab=runs&run={name}")
    page.locator(".q-notification__message", has_text="leads out of the runs folder").wait_for()
    assert page.locator(".shown-body").count() == 0


def test_a_fit_gives_the_numbers_of_the_command(filled: Web, open_page: Opens) -> None:
    page = open_page(f"{filled.url}?tab=fit&data=quad")
    page.get_by_label("body_lift.K_b is free").wait_for()
    wait_for_controls(page)
    name = page.get_by_label("Name of the fit's folder")
    for taken, reason in (("../evil", "cannot name a run"), ("quad", "quad exists already")):
        name.fill(taken)
        page.locator(".command-text", has_text=taken).wait_for()
        page.get_by_role("button", name="Fit", exact=True).click()
        page.locator(".q-notification__message", has_text=reason).wait_for()
    name.fill("fit-here")
    command = page.locator(".command-text", has_text="fit-here")
    command.wait_for()
    words = shlex.split(command.inner_text())
    page.get_by_label("neighbour_images.strength is held at").fill("0.9")
    page.locator(".command-text", has_text="--fix neighbour_images.strength=0.9").wait_for()
    page.get_by_label("neighbour_images.strength is held at").fill("1")
    page.locator(".command-text", has_text=re.compile("^((?!--fix).)*$")).first.wait_for()
    page.get_by_role("button", name="Fit", exact=True).click()
    row = page.locator(".shown-body").get_by_role("row", name=re.compile("^body_lift.K_b"))
    row.wait_for(timeout=COLD_MS)
    shown = row.locator("td").all_inner_texts()
    assert (words[0], words[-2:]) == ("benchtool", ["--out", str(filled.runs / "fit-here")])
    printed = subprocess.run(
        [sys.executable, "-m", "benchtool", *words[1:-2]],
        capture_output=True,
        encoding="utf-8",
        check=True,
    ).stdout
    line = next(text for text in printed.splitlines() if text.strip().startswith("body_lift.K_b"))
    assert line.split() == ["body_lift.K_b", *" ".join(shown).split()]
    made = {item.name for item in (filled.runs / "fit-here").iterdir()}
    assert {"result.json", "model.toml", "report.html", "ratio.svg"} <= made
    assert not (filled.runs.parent / "evil").exists()


def test_the_form_shows_the_numbers_of_the_runs_own_rig(
    browser: Browser, tmp_path: Path, open_page: Opens
) -> None:
    shutil.copytree(TOP / "datasets" / "quad" / "run", tmp_path / "runs" / "own")
    metadata = tmp_path / "runs" / "own" / "metadata.json"
    facts = json.loads(metadata.read_text("utf-8"))
    facts["rig"]["propulsion"]["radius_m"] = 0.125
    metadata.write_text(json.dumps(facts), "utf-8")
    with serving(tmp_path / "runs", tmp_path / "state") as web:
        page = open_page(f"{web.url}?tab=fit")
        radius, strength = (
            page.get_by_label(f"{name} is held at") for name in ("R_m", "neighbour_images.strength")
        )
        strength.fill("0.9")
        expect(radius).to_have_value("0.12")
        page.get_by_label("Runs and tables").click()
        page.get_by_role("option", name=re.compile("^own")).click()
        page.locator(".command-text", has_text="runs/own").wait_for()
        expect(radius).to_have_value("0.125")
        command = page.locator(".command-text", has_text="--fix neighbour_images.strength=0.9")
        command.wait_for()
        # What somebody had changed stays.
        assert strength.input_value() == "0.9"
        assert "R_m" not in command.inner_text()


def test_a_table_is_handed_over_and_a_bad_cell_is_told(filled: Web, open_page: Opens) -> None:
    page = open_page(f"{filled.url}?tab=fit")
    page.get_by_text("Or upload a CSV file or a log", exact=True).wait_for()
    wait_for_controls(page)
    chooser = page.locator("input[type=file]")
    chooser.set_input_files({"name": "x.csv", "mimeType": "text/csv", "buffer": b"\0\1\2"})
    page.locator(".q-notification", has_text="not a text file").get_by_role("button").click()
    chooser.set_input_files({"name": "../../lab.csv", "mimeType": "text/csv", "buffer": LAB})
    page.get_by_text(re.compile(r"^Columns of .*-lab(-\d)?/lab\.csv")).wait_for()
    # A note lies over the lists until it goes.
    page.locator(".q-notification__message", has_text="saved as").wait_for(state="hidden")
    for channel, column in (("thrust_N (needed)", "F_gf"), ("rpm1 (or that", "speed")):
        page.get_by_label(channel).click()
        page.get_by_role("option", name=column, exact=True).click()
    page.get_by_role("button", name="Use these columns").click()
    bad = page.locator(".q-notification__message", has_text="line 3: column 'speed' holds 'x'")
    bad.wait_for(timeout=COLD_MS)
    assert {item.name for item in filled.runs.parent.iterdir()} <= {"runs", "state", "secret.csv"}


def test_a_table_sorts_and_a_figure_opens_large(filled: Web, open_page: Opens) -> None:
    page = open_page(f"{filled.url}?tab=runs&run=single_rotor")
    table = page.locator("table.shown").first
    first = table.locator("tbody tr").first.locator("th")
    expect(first).to_have_text("0.6", timeout=COLD_MS)
    head = table.get_by_role("button").first
    head.click()
    head.click()
    expect(table.locator("th[aria-sort=descending]")).to_have_count(1)
    expect(first).not_to_have_text("0.6")
    page.get_by_role("button", name="Enlarge").first.click()
    large = page.locator(".figure-large")
    large.locator("img").hover()
    expect(large.get_by_role("status")).to_contain_text("distance to the plate")
    large.get_by_role("button", name="Close").click()
    expect(large).to_have_count(0)
