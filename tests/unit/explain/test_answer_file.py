"""The answer as JSON: the keys of the issue, always there, and plain JSON."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from benchtool.core.schedule_file import schedule_named
from benchtool.explain.engine.verdict import KINDS, Kind, NotJudged
from benchtool.explain.next_steps import next_file
from benchtool.explain.recordings import names_of
from benchtool.report.answer.folder import Written, answer_tables
from benchtool.report.answer.page import answer_page
from benchtool.report.html import render_report
from tests.unit.explain.hand_made import NEXT, answer, gap, source, verdict

PROMISED = (
    "version", "verdict", "effects", "class", "where", "gap", "nearest", "tolerances",
    "next_experiment", "model_out", "seconds",
)  # fmt: skip


def tables(kind: Kind, written: Written | None = None) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(
        json.dumps(answer_tables(answer(kind), written or Written()), allow_nan=False)
    )
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_every_promised_key_is_there_whatever_the_verdict(kind: Kind) -> None:
    found = tables(kind)
    assert set(PROMISED) <= set(found)
    assert found["version"] == 2
    assert found["verdict"] == kind
    assert set(found["where"]) >= {"stage", "regime"}
    assert set(found["nearest"]) == {"name", "share_closed", "after", "model"}
    assert set(found["gap"]) == {"theta_rad", "gyro_rad_s", "rpm"}
    assert all({"unit", "before", "after", "floor"} <= set(one) for one in found["gap"].values())
    assert found["tolerances"]["coulomb_friction.torque_Nm"] == 0.002


def test_an_effect_is_told_with_its_numbers_and_evidence() -> None:
    found = tables("effect", Written(model="out/model.toml"))
    (effect,) = found["effects"]
    assert effect["name"] == "coulomb_friction"
    assert effect["parameters"]["torque_Nm"]["value"] == 0.0241
    assert effect["parameters"]["torque_Nm"]["std"] == 0.0006
    assert effect["parameters"]["torque_Nm"]["unit"] == "N m"
    assert effect["log_likelihood_ratio"] == 512.3
    assert effect["p_value"] == 1e-30
    assert found["where"]["stage"] == "hinge"
    assert found["where"]["regime"] == "slow reversals"
    assert found["class"] == []
    assert found["model_out"] == "out/model.toml"
    assert found["seconds"] == 4.2


def test_nothing_missing_leaves_the_gap_as_it_was_and_names_nothing() -> None:
    found = tables("none")
    assert found["effects"] == []
    assert found["where"]["stage"] is None
    assert found["model_out"] is None
    assert all(one["after"] == one["before"] for one in found["gap"].values())


def test_a_class_has_its_members_and_the_experiment_that_separates_them(tmp_path: Path) -> None:
    found = tables("class", Written(schedule="out/next_schedule.toml"))
    assert found["class"] == ["coulomb_friction", "cog_offset"]
    experiment = found["next_experiment"]
    assert experiment["kind"] == "schedule"
    assert experiment["file"] == "out/next_schedule.toml"
    assert experiment["expected"] == {"cog_offset": 40.0}
    path = tmp_path / "next.toml"
    path.write_text(experiment["text"], encoding="utf-8")
    assert schedule_named(path) == NEXT.schedule


def test_an_unknown_tells_the_nearest_effect() -> None:
    found = tables("unknown", Written(nearest="out/model_nearest.toml"))
    near = found["nearest"]
    assert (near["name"], near["share_closed"]) == ("coulomb_friction", 0.61)
    assert near["after"] == {"theta_rad": 0.011, "gyro_rad_s": 0.045, "rpm": 31.0}
    assert near["model"] == "out/model_nearest.toml"
    assert found["effects"] == found["class"] == []


def test_a_plan_of_a_sweep_is_handed_on_as_it_is() -> None:
    plan = replace(NEXT, schedule=None, plan_toml="seed = 3\n")
    found = replace(
        answer("class"),
        explanation=replace(answer("class").explanation, verdict=verdict("class", next=plan)),
    )
    assert next_file(found) == ("next_plan.toml", "seed = 3\n")
    assert answer_tables(found, Written())["next_experiment"]["kind"] == "plan"


def test_what_is_not_judged_is_numbers_with_a_sentence() -> None:
    trace = {"motor_lag": NotJudged.below(5000.0), "plate_offset": NotJudged.below(4.2)}
    told = replace(answer(), explanation=replace(
        answer().explanation, verdict=verdict(not_judged=trace)
    ))  # fmt: skip
    found = json.loads(json.dumps(answer_tables(told, Written()), allow_nan=False))["not_judged"]
    assert found["motor_lag"] == {
        "reason": "no_trace", "tolerances_needed": None,
        "sentence": "leaves no trace in this data, however large it is",
    }  # fmt: skip
    assert found["plate_offset"]["reason"] == "too_weak"
    assert found["plate_offset"]["tolerances_needed"] == 4.2
    assert found["plate_offset"]["sentence"].endswith("(dz_m off by 0.0126 m)")


def test_several_effects_have_probabilities_of_their_own_places() -> None:
    found = tables("several")
    assert [place["effect"] for place in found["places"]] == [e["name"] for e in found["effects"]]
    assert all(sum(one["probabilities"].values()) == pytest.approx(1.0) for one in found["places"])
    assert (
        "probability 0.98; and may lack centre-of-gravity offset: cog_offset.x_m = -0.0014"
        in found["sentence"]
    )
    assert found["sentence"].endswith("probability 0.60.")
    assert len(tables("effect")["places"]) == 1


def test_numbers_that_json_has_not_become_null() -> None:
    broken = verdict(gaps=(gap("theta_rad", "rad", float("nan"), float("inf"), 0.1),))
    found = replace(
        answer(), explanation=replace(answer().explanation, verdict=broken)
    )  # fmt: skip
    assert answer_tables(found, Written())["gap"]["theta_rad"]["before"] is None


def test_recordings_of_one_name_stand_apart_in_every_list() -> None:
    paths = ("one/pid.csv", "two/pid.csv", "check.csv")
    names = names_of(paths)
    learn = tuple(replace(source(path, path[:3]), name=names[path]) for path in paths[:2])
    check = (replace(source(paths[2], "che"), name=names[paths[2]]),)
    twice = answer("effect", learn=learn, check=check)
    assert twice.hashes == {"one/pid.csv": "one", "two/pid.csv": "two", "check.csv": "che"}
    data = answer_tables(twice, Written())["data"]
    assert data == {
        "learn": {"one/pid.csv": "one", "two/pid.csv": "two"}, "check": {"check.csv": "che"},
    }  # fmt: skip
    page = render_report(answer_page(twice, {}))
    assert "one/pid.csv, two/pid.csv" in page
