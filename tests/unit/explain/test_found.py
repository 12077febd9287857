"""From what readings miss to what it depends on, a law, and an effect file."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from benchtool.core.rig_file import load_rig_by_name
from benchtool.explain.law_search import find_dependence
from benchtool.explain.laws import DRAFT_NAME, FAMILIES, FoundDependence, LawFamily, draft_effect
from benchtool.explain.next_steps import next_steps
from benchtool.explain.result import Explanation
from benchtool.physics.catalogue import EFFECTS, user_effects
from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.effect import BenchKind
from benchtool.report.answer.folder import write_folder
from tests.contracts import test_effect as contract
from tests.unit.explain.found_made import LAWS, PLACES, shown
from tests.unit.explain.hand_made import answer

RADIUS_M = 0.12


@pytest.mark.parametrize("name", LAWS)
def test_a_law_is_found_with_its_variable_and_closes_the_gap(name, rng):
    speed = rng.uniform(0.7, 1.3, 150)
    law = LAWS[name](speed)
    found = find_dependence(shown(law, rng, speed), RADIUS_M)
    assert found is not None
    assert found.variable.phrase == "rotor speed"
    assert found.probability > 0.9
    assert found.closed > 0.9
    assert found.law is not None
    left = law - found.law.amplitude * found.law.family(speed, found.law.numbers)
    assert np.std(left) < 0.15 * np.std(law)
    assert found.text.startswith("depends on rotor speed; closes ")
    assert np.ptp(found.curve.mean) == pytest.approx(np.ptp(law), rel=0.5)


def test_what_is_another_at_every_visit_has_a_variable_and_no_law(rng):
    each = 0.02 * rng.standard_normal(30)
    found = find_dependence(shown(each[PLACES], rng, rng.uniform(0.7, 1.3, 150)), RADIUS_M)
    assert found is not None
    assert (found.phrase, found.law, found.text) == ("the visit", None, "depends on the visit")


def test_noise_depends_on_nothing(rng):
    found = [
        find_dependence(shown(np.zeros(150), rng, rng.uniform(0.7, 1.3, 150)), RADIUS_M)
        for _ in range(50)
    ]
    assert found == [None] * 50


def drafted(family: LawFamily, rng: np.random.Generator) -> FoundDependence:
    """Return a dependence whose law is of a family."""
    speed = rng.uniform(0.7, 1.3, 150)
    found = find_dependence(shown(LAWS["line"](speed), rng, speed), RADIUS_M)
    assert found is not None
    assert found.law is not None
    grid = family.grid(speed)
    numbers = tuple(float(one) for one in grid[:, grid.shape[1] // 2])
    law = replace(found.law, family=family, numbers=numbers, sds=(0.01,) * len(numbers))
    return replace(found, law=law)


CHANGES = {  # what a law becomes in each hook, and a variable that it may see, with its reference
    "factor": ("1.0 + p.a * {f}", "flow.speed_rad_s[i] / p.reference", 500.0),
    "thrust_reading": ("reading + p.a * p.typical * {f}", "reading / p.reference", 10.5),
    "torque": ("p.a * p.typical * {f}", "flow.rate_rad_s / p.reference", 0.5),
    "gyro_reading": ("reading + p.a * p.typical * {f}", "flow.time_s / p.reference", 60.0),
}


DRAFTED = [(family, "factor") for family in FAMILIES] + [(FAMILIES[1], hook) for hook in CHANGES]


@pytest.mark.parametrize(("family", "hook"), DRAFTED, ids=lambda one: getattr(one, "name", one))
def test_a_draft_keeps_the_contract_of_effects(family, hook, tmp_path, rng, monkeypatch):
    found = drafted(family, rng)
    code, seen, reference = CHANGES[hook]
    bench: BenchKind = "pitch" if hook in ("torque", "gyro_reading") else "sweep"
    found = replace(
        found,
        variable=replace(found.variable, code=seen, reference=reference),
        form=replace(found.form, hook=hook, code=code, bench=bench),
    )
    path = tmp_path / f"{DRAFT_NAME}.py"
    path.write_text(draft_effect(found), encoding="utf-8")
    (effect,) = user_effects(str(path), lambda _: None)
    monkeypatch.setitem(EFFECTS, DRAFT_NAME, effect)
    monkeypatch.setitem(contract.TWO_SIDED, f"{DRAFT_NAME}.a", "nobody knows its cause")
    rig = load_rig_by_name("pquad")
    conditions = Conditions.build(
        rig, speed_rad_s=np.array([[460.0], [470.0], [480.0], [590.0]]),
        plate_z_m=np.array([0.1, 0.15, 0.2, 0.1, 0.3, 0.6]),
        plate_x_m=np.array([0.0, 0.0, 0.0, 0.6, 0.6, 0.0]), elapsed_s=60.0, time_s=60.0,
    )  # fmt: skip
    contract.test_it_describes_itself(DRAFT_NAME)
    contract.test_it_says_what_does_not_matter_on_any_vehicle(DRAFT_NAME)
    contract.test_physics_bounds_every_number_that_may_be_named(DRAFT_NAME)
    contract.test_at_its_neutral_value_it_is_exactly_absent(DRAFT_NAME, rig, conditions)
    contract.test_its_hooks_at_neutral_change_nothing_when_they_are_called(
        DRAFT_NAME, rig, conditions
    )
    contract.test_at_neutral_a_hinge_is_left_exactly_alone(DRAFT_NAME, 0.5)
    contract.test_away_from_neutral_it_shows_somewhere(DRAFT_NAME, rig, conditions)
    contract.test_scalars_arrays_and_complex_steps_agree(DRAFT_NAME, rig, conditions)
    contract.test_its_hooks_branch_nowhere(DRAFT_NAME)
    assert effect.phrase == "found effect"


def unknown(found: FoundDependence) -> Explanation:
    """Return an answer that says unknown, and what it depends on."""
    return answer("unknown", depends=found)


def test_a_draft_is_written_once_and_told_of(tmp_path, rng):
    speed = rng.uniform(0.7, 1.3, 150)
    found = find_dependence(shown(LAWS["resonance"](speed), rng, speed), RADIUS_M)
    assert found is not None
    made, folder = unknown(found), tmp_path / "found"
    assert "; it depends on rotor speed; closes " in made.sentence
    names = ("found_effect.py", "found_effect_2.py")
    first = write_folder(folder, made)["draft"]
    mine = "a person has named it"
    (folder / names[0]).write_text(mine, encoding="utf-8")
    assert [first, write_folder(folder, made)["draft"]] == [str(folder / name) for name in names]
    assert (folder / names[0]).read_text("utf-8") == mine
    depends = json.loads((folder / "answer.json").read_text("utf-8"))["depends"]
    assert depends["numbers"]["at"] == pytest.approx(0.93, abs=0.01)
    assert any("found_effect.py" in step.command for step in next_steps(made, str(folder)))
