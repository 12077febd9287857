"""An answer as JSON, page, model file and next steps."""

from __future__ import annotations

import json
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import pytest
from typer.main import get_command

from benchtool.commands.app import build_app
from benchtool.core.parameter import Parameters
from benchtool.core.schedule import load_schedule
from benchtool.explain.findings import UnjudgedEffect
from benchtool.explain.next_steps import format_added_model, next_steps
from benchtool.explain.result import Kind
from benchtool.physics.model_file import load_model, model_from_toml
from benchtool.report.answer.folder import answer_tables, write_folder
from benchtool.report.answer.page import changes
from tests.unit.explain.hand_made import MODEL, NEXT, answer, gap

PROMISED = (
    "version", "verdict", "effects", "class", "where", "gap", "nearest", "tolerances",
    "next_experiment", "model_out", "seconds",
)  # fmt: skip


def tables(kind: Kind, **written: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(
        json.dumps(answer_tables(answer(kind), **written), allow_nan=False)
    )
    return found


@pytest.mark.parametrize("kind", get_args(Kind))
def test_every_promised_key_is_there_whatever_the_verdict(kind):
    found = tables(kind)
    assert set(PROMISED) <= set(found)
    assert found["version"] == 2
    assert found["verdict"] == kind
    assert all({"unit", "before", "after", "floor"} <= set(one) for one in found["gap"].values())
    assert found["tolerances"]["coulomb_friction.torque_Nm"] == 0.002


def test_a_class_has_its_members_and_the_experiment_that_separates_them(tmp_path):
    found = tables("class", schedule="out/next_schedule.toml")
    assert found["class"] == ["coulomb_friction", "cog_offset"]
    experiment = found["next_experiment"]
    assert experiment["kind"] == "schedule"
    assert experiment["file"] == "out/next_schedule.toml"
    assert experiment["expected"] == {"cog_offset": 40.0}
    path = tmp_path / "next.toml"
    path.write_text(experiment["text"], encoding="utf-8")
    assert load_schedule(path) == NEXT.schedule


def test_what_is_not_judged_is_numbers_with_a_sentence():
    trace = {"motor_lag": UnjudgedEffect.below(5000.0), "plate_offset": UnjudgedEffect.below(4.2)}
    told = answer(not_judged=trace)
    found = json.loads(json.dumps(answer_tables(told), allow_nan=False))["not_judged"]
    assert found["motor_lag"] == {
        "reason": "no_trace", "tolerances_needed": None,
        "sentence": "has no effect on this data at any size",
    }  # fmt: skip
    assert found["plate_offset"]["tolerances_needed"] == 4.2


def test_numbers_that_json_has_not_become_null():
    found = answer(gaps=(gap("theta_rad", "rad", float("nan"), float("inf"), 0.1),))
    assert answer_tables(found)["gap"]["theta_rad"]["before"] is None


@pytest.mark.parametrize("folder", ["", "found"])
@pytest.mark.parametrize("kind", get_args(Kind))
def test_every_option_of_the_commands_exists(kind, folder):
    for step in next_steps(answer(kind), folder):
        program, name, *words = shlex.split(step.command)
        assert program == "benchtool"
        group: Any = get_command(build_app([name, words[0]]))
        command = group.commands[name]
        command = getattr(command, "commands", {}).get(words[0], command)
        options = {word for word in words if word.startswith("--")}
        assert options <= {option for item in command.params for option in item.opts}


def test_the_named_effect_and_the_calibrated_inertia_stand_in_it_with_their_source():
    again = model_from_toml(format_added_model(answer()), "new.toml")
    parent = load_model(MODEL)
    friction = again.model.parameters["coulomb_friction.torque_Nm"]
    assert friction.value == 0.0241
    assert friction.tolerance == 0.002
    assert "learn.csv" in friction.source
    assert again.model.parameters["inertia_kgm2"].value == 0.0309
    assert again.model.parameters["inertia_kgm2"].prior == parent.model.parameters[
        "inertia_kgm2"
    ].prior  # fmt: skip
    assert again.columns == parent.columns
    assert again.model.wake_rule == "full"
    kept = {name for name in parent.model.parameters if "friction" not in name} - {"inertia_kgm2"}
    assert all(
        again.model.parameters[name].value == parent.model.parameters[name].value for name in kept
    )


def test_of_a_sweep_what_was_adjusted_stays_free_under_what_was_known_of_it():
    parent = load_model(MODEL).model.parameters
    moved = {"inertia_kgm2": 0.0309, "k": 1.01 * parent["k"].value}
    found = Parameters(
        (name, item.with_value(moved.get(name, item.value))) for name, item in parent.items()
    )
    made = format_added_model(answer(bench="sweep", parameters=found))
    new = model_from_toml(made, "new.toml").model.parameters
    assert new["inertia_kgm2"].free
    assert new["inertia_kgm2"].prior == parent["inertia_kgm2"].prior
    assert new["k"].free
    assert (new["k"].prior.kind, new["k"].prior.mean) == ("normal", parent["k"].value)
    assert new["k"].prior.sd == pytest.approx(0.01 * parent["k"].value)
    assert not new["R_m"].free
    pitch = model_from_toml(format_added_model(answer()), "new.toml").model.parameters
    assert not pitch["inertia_kgm2"].free


def test_of_a_class_the_likeliest_is_added_alone():
    model = model_from_toml(format_added_model(answer("class")), "new.toml").model
    assert model.parameters["coulomb_friction.torque_Nm"].value == 0.0241
    assert model.parameters["cog_offset.x_m"].value == 0.0


def test_an_effect_that_the_parent_has_not_is_put_in():
    loaded = load_model(MODEL)
    bare = replace(loaded, model=loaded.model.without("coulomb_friction"))
    calibrated = bare.model.with_effect("speed_map", gain=0.003).parameters
    found = answer(loaded=bare, parameters=calibrated)
    model = model_from_toml(format_added_model(found), "new.toml").model
    assert model.parameters["coulomb_friction.torque_Nm"].value == 0.0241
    assert model.parameters["speed_map.gain"].value == 0.003


def test_an_effect_that_came_out_as_nothing_is_not_in_the_model():
    loaded = load_model(MODEL)
    tuned = loaded.model.with_effect("gyro_lag", late_s=-8.5e-6).parameters
    found = answer(loaded=loaded, parameters=tuned)
    model = model_from_toml(format_added_model(found), "new.toml").model
    assert "gyro_lag.late_s" not in model.parameters
    assert not any("gyro_lag" in change.name for change in changes(found))


def test_a_rig_beside_the_parent_goes_with_the_model(tmp_path):
    from importlib import resources

    rig = tmp_path / "mine.toml"
    text = (resources.files("benchtool") / "library" / "rigs" / "beam.toml").read_text("utf-8")
    rig.write_text(text.replace('name = "beam"', 'name = "mine"'), encoding="utf-8")
    parent = tmp_path / "model.toml"
    parent.write_text(MODEL.read_text("utf-8").replace('"beam"', '"mine.toml"'), encoding="utf-8")
    out = tmp_path / "out"
    write_folder(out, answer(loaded=load_model(parent)))
    assert load_model(out / "model.toml").model.rig.name == "mine"


def test_something_unknown_has_a_model_of_the_nearest_and_its_gap(tmp_path):
    given = answer("unknown")
    written = write_folder(tmp_path / "out", given)
    assert "model" not in written
    assert Path(written["nearest"]).name == "model_nearest.toml"
    loaded = load_model(written["nearest"])
    assert loaded.model.parameters["coulomb_friction.torque_Nm"].value == 0.0241
    assert "only the nearest, and closes 61 % of the gap" in loaded.model.provenance["verdict"]
    near = json.loads((tmp_path / "out" / "answer.json").read_text(encoding="utf-8"))["nearest"]
    assert near["after"]["theta_rad"] == 0.011
    assert near["model"] == written["nearest"]
