"""The new model file: the effect in it, what was calibrated, where it came from."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from benchtool.core.errors import WouldOverwrite
from benchtool.core.parameter import Parameters
from benchtool.explain.added_model import added_model
from benchtool.physics.model_file import load_model, model_from_toml
from benchtool.report.answer.folder import refuse_taken, write_folder
from tests.unit.explain.hand_made import MODEL, answer, verdict


def test_the_named_effect_and_the_calibrated_inertia_stand_in_it_with_their_source() -> None:
    again = model_from_toml(added_model(answer()), "new.toml")
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


def test_of_a_sweep_what_was_adjusted_stays_free_under_what_was_known_of_it() -> None:
    parent = load_model(MODEL).model.parameters
    moved = {"inertia_kgm2": 0.0309, "k": 1.01 * parent["k"].value}
    found = Parameters(
        (name, item.at(moved.get(name, item.value))) for name, item in parent.items()
    )
    told = answer()
    swept = verdict("effect", bench="sweep", parameters=found)
    made = added_model(replace(told, explanation=replace(told.explanation, verdict=swept)))
    new = model_from_toml(made, "new.toml").model.parameters
    assert new["inertia_kgm2"].free
    assert new["inertia_kgm2"].prior == parent["inertia_kgm2"].prior
    assert new["k"].free
    assert (new["k"].prior.kind, new["k"].prior.mean) == ("normal", parent["k"].value)
    assert new["k"].prior.sd == pytest.approx(0.01 * parent["k"].value)
    assert not new["R_m"].free
    pitch = model_from_toml(added_model(told), "new.toml").model.parameters
    assert not pitch["inertia_kgm2"].free


def test_it_says_what_made_it_from_which_data_on_what_evidence() -> None:
    facts = model_from_toml(added_model(answer()), "new.toml").model.provenance
    assert facts["sha256.learn.csv"] == "1" * 64
    assert facts["sha256.check.csv"] == "2" * 64
    assert facts["parent"] == "pitch_bench (model.toml)"
    assert facts["parent_sha256"] == "c0ffee"
    assert "512.3" in facts["evidence.coulomb_friction"]
    assert "0.984" in facts["evidence.coulomb_friction"]
    assert facts["made_by"].startswith("benchtool ")


def test_a_second_round_keeps_what_the_first_one_said() -> None:
    first = model_from_toml(added_model(answer()), "first.toml")
    second = model_from_toml(added_model(answer("several", loaded=first)), "second.toml")
    assert second.model.parameters["cog_offset.x_m"].value == -0.0014
    assert second.model.provenance["parent.parent"] == "pitch_bench (model.toml)"


def test_of_a_class_the_likeliest_is_added_alone() -> None:
    model = model_from_toml(added_model(answer("class")), "new.toml").model
    assert model.parameters["coulomb_friction.torque_Nm"].value == 0.0241
    assert model.parameters["cog_offset.x_m"].value == 0.0


def test_an_effect_that_the_parent_has_not_is_put_in() -> None:
    loaded = load_model(MODEL)
    bare = replace(loaded, model=loaded.model.without("coulomb_friction"))
    calibrated = bare.model.with_effect("speed_map", gain=0.003).parameters
    asked = answer(loaded=bare)
    found = replace(
        asked, explanation=replace(asked.explanation, verdict=verdict(parameters=calibrated))
    )
    model = model_from_toml(added_model(found), "new.toml").model
    assert model.parameters["coulomb_friction.torque_Nm"].value == 0.0241
    assert model.parameters["speed_map.gain"].value == 0.003


def test_a_sweep_leaves_what_it_found_free_to_be_fitted() -> None:
    asked = answer()
    found = replace(
        asked, explanation=replace(asked.explanation, verdict=verdict(bench="sweep"))
    )  # fmt: skip
    model = model_from_toml(added_model(found), "new.toml").model
    assert model.parameters.free_names == ("inertia_kgm2", "coulomb_friction.torque_Nm")


def test_the_folder_has_page_figures_model_and_the_next_schedule(tmp_path: Path) -> None:
    out = tmp_path / "answer"
    refuse_taken(out, tmp_path / "answer.json")
    written = write_folder(out, answer("class"))
    names = {path.name for path in out.iterdir()}
    assert {"report.html", "answer.json", "model.toml", "next_schedule.toml"} <= names
    assert {"where.svg", "which.svg", "parameters.svg", "gap.svg", "overlay_theta_rad.png"} <= names
    assert written.model == str(out / "model.toml")
    page = (out / "report.html").read_text("utf-8")
    assert "The model lacks one of Coulomb friction, centre-of-gravity offset; this" in page
    assert "2 gaps in time" in page
    assert page.count("<svg") == 5
    with pytest.raises(WouldOverwrite, match="--overwrite"):
        refuse_taken(out, None)
    with pytest.raises(WouldOverwrite, match="--overwrite"):
        refuse_taken(None, out / "answer.json")


def test_a_rig_beside_the_parent_goes_with_the_model(tmp_path: Path) -> None:
    from importlib import resources

    rig = tmp_path / "mine.toml"
    text = (resources.files("benchtool") / "library" / "rigs" / "beam.toml").read_text("utf-8")
    rig.write_text(text.replace('name = "beam"', 'name = "mine"'), encoding="utf-8")
    parent = tmp_path / "model.toml"
    parent.write_text(MODEL.read_text("utf-8").replace('"beam"', '"mine.toml"'), encoding="utf-8")
    out = tmp_path / "out"
    write_folder(out, answer(loaded=load_model(parent)))
    assert load_model(out / "model.toml").model.rig.name == "mine"


def test_something_unknown_has_a_model_of_the_nearest_and_its_gap(tmp_path: Path) -> None:
    given = answer("unknown")
    written = write_folder(tmp_path / "out", given)
    assert written.model == ""
    assert Path(written.nearest).name == "model_nearest.toml"
    loaded = load_model(written.nearest)
    assert loaded.model.parameters["coulomb_friction.torque_Nm"].value == 0.0241
    assert "only the nearest, and closes 61 % of the gap" in loaded.model.provenance["verdict"]
    text = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "With Coulomb friction, the nearest, the gap would be: pitch 0.917 → 0.63 deg" in text
    near = json.loads((tmp_path / "out" / "answer.json").read_text(encoding="utf-8"))["nearest"]
    assert near["after"]["theta_rad"] == 0.011
    assert near["model"] == written.nearest


def test_nothing_missing_writes_no_model(tmp_path: Path) -> None:
    written = write_folder(tmp_path / "out", answer("none"))
    assert written.model == ""
    assert not (tmp_path / "out" / "model.toml").exists()
    assert "within their noise" in (tmp_path / "out" / "report.html").read_text("utf-8")
