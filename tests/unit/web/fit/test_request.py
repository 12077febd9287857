"""The Fit form as a recipe, as a command, and as a folder written by a worker process."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from benchtool.core.errors import InputError, UnknownChoice, WouldOverwrite
from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.atomic import partial_folder
from benchtool.data.catalogue.index import list_entries
from benchtool.data.run.runs_folder import RunsFolder, column_map_path
from benchtool.data.run.state import store_state
from benchtool.fit.fit_data import recipe_model
from benchtool.fit.result_file import read_fit
from benchtool.fit.run_recipe import run_recipe
from benchtool.web.command_jobs import command_arguments, fit_to_folder
from benchtool.web.tabs.fit import (
    FitRequest,
    ParameterChoice,
    build_fit_inputs,
    data_rig,
    form_parameters,
)

RUN = Path(__file__).parents[4] / "datasets/single_rotor/run"


@pytest.fixture
def folder(tmp_path):
    shutil.copytree(RUN, tmp_path / "runs" / "one")
    (tmp_path / "runs" / "lab.csv").write_text("F,rpm1\n1,2\n", "utf-8")
    return RunsFolder(tmp_path / "runs")


@pytest.fixture
def entries(folder):
    return {entry.name: entry for entry in list_entries(folder)}


def request(**changes: object) -> FitRequest:
    fields: dict[str, object] = {"data": ["one"], "model": "single_bench", "name": "fit-one"}
    return FitRequest(**{**fields, **changes})  # type: ignore[arg-type]


def test_the_form_gives_a_recipe_and_its_words(folder, entries):
    fixed = {"R_m": ParameterChoice(False, 0.13)}
    methods = ["least_squares", "emcee"]
    options = {"method": methods, "profile": True, "budget": "mc", "temperature": "21"}
    inputs = build_fit_inputs(request(choices=fixed, options=options), folder, entries)
    assert inputs.recipe.data == (str(folder.root / "one"),)
    arguments = command_arguments(inputs)
    assert arguments[:4] == ["fit", str(folder.root / "one"), "--model", "single_bench"]
    assert arguments[4:] == [
        *("--method", "least_squares", "--method", "emcee", "--fix", "R_m=0.13"),
        *("--temperature", "21", "--profile", "--budget", "mc"),
        *("--out", str(folder.root / "fit-one")),
    ]


def test_the_numbers_shown_are_those_of_the_runs_rig(folder, entries):
    metadata = folder.root / "one" / "metadata.json"
    facts = json.loads(metadata.read_text("utf-8"))
    facts["rig"]["propulsion"]["radius_m"] = 0.2
    metadata.write_text(json.dumps(facts), "utf-8")
    rig = data_rig(request(data=["one", "lab.csv"]), folder)
    assert rig is not None
    numbers, defaults = form_parameters("single_bench", rig), form_parameters("single_bench")
    assert numbers["R_m"].value == 0.2 != defaults["R_m"].value
    # The displayed value needs no option; the value of the model file differs here and does.
    for value, fix in ((0.2, {}), (defaults["R_m"].value, {"R_m": defaults["R_m"].value})):
        form = request(choices={"R_m": ParameterChoice(False, value)})
        recipe = build_fit_inputs(form, folder, entries).recipe
        assert recipe.fix == fix
        assert recipe_model(recipe).model.parameters["R_m"].value == value
    with pytest.raises(InputError, match=r"lab\.csv does not say which rig it was measured on"):
        data_rig(request(data=["lab.csv"]), folder)
    rig = data_rig(request(data=["lab.csv"], options={"rig": "amuse_single"}), folder)
    assert rig == load_rig_by_name("amuse_single")


def test_a_tables_own_map_goes_with_it(folder, entries):
    table = folder.find_path("lab.csv")
    column_map_path(table).write_text('[columns]\nthrust_N = { column = "F" }\n', "utf-8")
    form = request(data=["lab.csv"], options={"rig": "pquad_single"})
    recipe = build_fit_inputs(form, folder, entries).recipe
    assert recipe.columns == str(column_map_path(table))
    (folder.root / "two.csv").write_text("thrust_N,rpm1\n1,2\n", "utf-8")
    both = {entry.name: entry for entry in list_entries(folder)}
    with pytest.raises(InputError, match="a fit uses one"):
        build_fit_inputs(request(data=["lab.csv", "two.csv"]), folder, both)


def test_the_work_writes_what_the_command_would(folder, entries):
    inputs = build_fit_inputs(request(), folder, entries)
    stages: list[str] = []

    def report(stage: str, share: float) -> None:
        stages.append(stage)

    out = folder.new_path("fit-one")
    arguments = command_arguments(inputs)
    section = fit_to_folder(report, out, tuple(arguments), inputs)
    assert (section.title, section.command) == ("fit-one", tuple(arguments))
    assert stages == ["reading", "least squares", "drawing"]
    expected = run_recipe(inputs.recipe).results[0]
    assert read_fit(out).results[0]["R_m"] == expected["R_m"]
    assert f"benchtool {' '.join(arguments)}" in (out / "report.html").read_text("utf-8")
    assert not partial_folder(out).exists()
    with pytest.raises(WouldOverwrite):
        fit_to_folder(report, out, tuple(arguments), inputs)


def test_a_table_takes_only_calibrations_that_this_machine_stored(
    folder, entries, tmp_path, monkeypatch
):
    monkeypatch.setenv("BENCHTOOL_STATE", str(tmp_path / "state"))
    stored = str(store_state("calibration", "bench-01", {}))
    table = {"data": ["one"], "options": {"calibration": stored}}
    assert build_fit_inputs(request(**table), folder, entries).recipe.calibration == stored
    other = {**table, "options": {"calibration": "/etc/hostname"}}
    with pytest.raises(UnknownChoice, match="hostname"):
        build_fit_inputs(request(**other), folder, entries)
