"""The Fit form as a recipe, as a command, and as a folder that a process of its own writes."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from benchtool.core.errors import InputError, UnknownChoice, WouldOverwrite
from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.atomic import partial_folder
from benchtool.data.catalogue.index import list_entries
from benchtool.data.run.runs_folder import RunsFolder, columns_file
from benchtool.data.run.state import store_state
from benchtool.fit.fit_data import recipe_model
from benchtool.fit.run_recipe import run_recipe
from benchtool.report.fit.stored_fit import read_stored
from benchtool.web.tabs.fit.model_choice import (
    FitRequest,
    ParameterChoice,
    command_arguments,
    data_rig,
    form_numbers,
    recipe_for,
)
from benchtool.web.tabs.fit.work import fit_to_folder

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
    given: dict[str, object] = {"data": ["one"], "model": "single_bench", "name": "fit-one"}
    return FitRequest(**{**given, **changes})  # type: ignore[arg-type]


def test_the_form_gives_a_recipe_and_its_words(folder, entries):
    fixed = {"R_m": ParameterChoice(False, 0.13)}
    methods = ["least_squares", "emcee"]
    options = {"method": methods, "profile": True, "budget": "mc", "temperature": "21"}
    form = request(choices=fixed, options=options)
    recipe = recipe_for(form, folder, entries)
    assert recipe.data == (str(folder.root / "one"),)
    words = command_arguments(recipe, form, folder)
    assert words[:4] == ["fit", str(folder.root / "one"), "--model", "single_bench"]
    assert words[4:] == [
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
    numbers, own = form_numbers("single_bench", rig), form_numbers("single_bench")
    assert numbers["R_m"].value == 0.2 != own["R_m"].value
    # What is shown needs no option; the model file's own number is another here, and does.
    for value, fix in ((0.2, {}), (own["R_m"].value, {"R_m": own["R_m"].value})):
        recipe = recipe_for(
            request(choices={"R_m": ParameterChoice(False, value)}), folder, entries
        )
        assert recipe.fix == fix
        assert recipe_model(recipe).model.parameters["R_m"].value == value
    with pytest.raises(InputError, match=r"lab\.csv does not say which rig it was measured on"):
        data_rig(request(data=["lab.csv"]), folder)
    named = data_rig(request(data=["lab.csv"], options={"rig": "amuse_single"}), folder)
    assert named == load_rig_by_name("amuse_single")


def test_a_tables_own_map_goes_with_it(folder, entries):
    table = folder.path_of("lab.csv")
    columns_file(table).write_text('[columns]\nthrust_N = { column = "F" }\n', "utf-8")
    form = request(data=["lab.csv"], options={"rig": "pquad_single"})
    recipe = recipe_for(form, folder, entries)
    assert recipe.columns == str(columns_file(table))
    (folder.root / "two.csv").write_text("thrust_N,rpm1\n1,2\n", "utf-8")
    both = {entry.name: entry for entry in list_entries(folder)}
    with pytest.raises(InputError, match="a fit takes one map"):
        recipe_for(request(data=["lab.csv", "two.csv"]), folder, both)


def test_the_work_writes_what_the_command_would(folder, entries):
    form = request()
    recipe = recipe_for(form, folder, entries)
    stages: list[str] = []

    def report(what: str, share: float) -> None:
        stages.append(what)

    out = folder.new_path("fit-one")
    words = command_arguments(recipe, form, folder)
    assert fit_to_folder(report, out, tuple(words), recipe, False) == "fit-one"
    assert stages == ["reading", "least squares", "drawing"]
    expected = run_recipe(recipe).results[0]
    found = read_stored(out).results[0]
    assert found["R_m"] == expected["R_m"]
    assert f"benchtool {' '.join(words)}" in (out / "report.html").read_text("utf-8")
    assert not partial_folder(out).exists()
    with pytest.raises(WouldOverwrite):
        fit_to_folder(report, out, tuple(words), recipe, False)


def test_a_table_takes_only_calibrations_that_this_machine_stored(
    folder, entries, tmp_path, monkeypatch
):
    monkeypatch.setenv("BENCHTOOL_STATE", str(tmp_path / "state"))
    stored = str(store_state("calibration", "bench-01", {}))
    table = {"data": ["one"], "options": {"calibration": stored}}
    assert recipe_for(request(**table), folder, entries).calibration == stored
    other = {**table, "options": {"calibration": "/etc/hostname"}}
    with pytest.raises(UnknownChoice, match="hostname"):
        recipe_for(request(**other), folder, entries)
