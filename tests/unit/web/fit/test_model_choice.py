"""Models of the Fit tab, and recipe options of its form."""

from __future__ import annotations

import pytest

from benchtool.core.errors import InputError
from benchtool.core.inputs import build_inputs
from benchtool.data.run.entry import Entry
from benchtool.data.run.runs_folder import RunsFolder
from benchtool.fit.fit_data import recipe_model
from benchtool.fit.recipe import Recipe
from benchtool.physics.model_file import load_model, model_to_toml
from benchtool.web.choices import model_choices, model_path
from benchtool.web.tabs.fit import ParameterChoice, choice_options, form_parameters


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "runs" / "fit").mkdir(parents=True)
    text = model_to_toml(load_model("quad_bench"))
    (tmp_path / "runs" / "fit" / "model.toml").write_text(text, "utf-8")
    (tmp_path / "outside.toml").write_text(text, "utf-8")
    return RunsFolder(tmp_path / "runs")


def test_shipped_models_and_those_of_fits_are_offered(folder):
    entries = [
        Entry(name="fit", kind="fit", rig="quad_bench"),
        Entry(name="broken", kind="fit", problem="it is broken"),
        Entry(name="one", kind="sweep"),
    ]
    choices = model_choices(folder, entries)
    assert choices["quad_bench"] == "quad_bench"
    assert [name for name in choices if "/" in name] == ["fit/model.toml"]
    assert model_path(folder, "quad_bench") == "quad_bench"
    path = model_path(folder, "fit/model.toml")
    assert load_model(path).model.name == "quad_bench"


@pytest.mark.parametrize(
    "line",
    ['rig = "../../outside.toml"', 'rig = "other.toml"', 'effects_file = "/tmp/x.py"',
     'effects_file = "../x.py"', 'effects_file = "x.py"'],
)  # fmt: skip
def test_a_model_may_not_lead_out_either(folder, line):
    path = folder.root / "fit" / "model.toml"
    text = path.read_text("utf-8")
    if line.startswith("rig"):
        text = text.replace('rig = "pquad"', line)
    else:
        text = text.replace('rig = "pquad"', f'rig = "pquad"\n{line}')
    assert line in text
    path.write_text(text, "utf-8")
    with pytest.raises(InputError):
        model_path(folder, "fit/model.toml")


def test_what_the_form_leaves_alone_needs_no_option():
    parameters = form_parameters("quad_bench")
    assert not any(name.startswith("noise.") for name in parameters)
    same = {name: ParameterChoice(item.free, item.value) for name, item in parameters.items()}
    assert choice_options(parameters, same) == {"free": [], "hold": [], "fix": {}}


def test_the_form_frees_holds_and_fixes():
    parameters = form_parameters("quad_bench")
    fixed = next(name for name, parameter in parameters.items() if not parameter.free)
    choices = {
        "body_lift.K_b": ParameterChoice(False, 2.5),
        "R_m": ParameterChoice(False, parameters["R_m"].value),
        fixed: ParameterChoice(True, parameters[fixed].value),
    }
    options = choice_options(parameters, choices)
    assert options == {"free": [fixed], "hold": ["R_m"], "fix": {"body_lift.K_b": 2.5}}
    recipe = build_inputs(
        Recipe, options, base=Recipe(name="x", data=("a",), model="quad_bench", rig="pquad")
    )
    parameters = recipe_model(recipe).model.parameters
    assert parameters[fixed].free
    assert not parameters["R_m"].free
    assert (parameters["body_lift.K_b"].free, parameters["body_lift.K_b"].value) == (False, 2.5)
