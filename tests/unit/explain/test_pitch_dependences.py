"""What a pitch recording misses, over what it may depend on."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchtool.explain.engine.hypotheses import Hypotheses
from benchtool.explain.law_search import find_dependence
from benchtool.explain.laws import FoundDependence
from benchtool.explain.pitch.dependences import summarize_residuals
from benchtool.explain.pitch.evidence import PitchEvidence
from benchtool.explain.pitch.log import pitch_log
from benchtool.physics.effects.effect import (
    Effect,
    Flow,
    Hooks,
    Quantity,
    expression,
    number,
)
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model
from tests.unit.explain.pitch_made import recorded

STIFFNESS_NM, FROM_RAD = 0.3, 0.05


@expression
def torque(p: Any, i: int, flow: Flow) -> Quantity:
    """Return the torque of rubber that the beam leans on beyond an angle: N m."""
    return -p.stiffness_Nm * np.maximum(flow.pitch_rad - FROM_RAD, 0.0)


RUBBER = Effect(
    name="rubber",
    title="Rubber stop",
    description="Rubber that the beam leans on.",
    subsystem="hinge",
    law="torque = -stiffness max(pitch - 0.05, 0)",
    parameters=(
        number("stiffness_Nm", "N m", 0.0, "torque per radian", neutral=0.0, tolerance=0.01),
    ),
    hooks=Hooks(torque=torque),
    shows="beyond an angle",
    source="made for this test",
    confused_with={},
    benches=frozenset({"pitch"}),
)


@pytest.fixture(scope="module")
def model():
    return load_model("pitch_beam").model.with_fixed("coulomb_friction.torque_Nm", 0.0)


def found_on(model: Model, truth: Model) -> FoundDependence | None:
    evidence = PitchEvidence(model, [pitch_log(recorded(truth, 1), truth.rig).logged])
    missed = summarize_residuals(evidence, Hypotheses(evidence).fit_null().values, [])
    return find_dependence(missed, model.rig.propulsion.radius_m)


@pytest.mark.slow
def test_what_leans_on_rubber_is_found_with_its_angle_and_stiffness(model):
    found = found_on(model, model.with_effect(RUBBER, stiffness_Nm=STIFFNESS_NM))
    assert found is not None
    assert (found.phrase, found.form.hook) == ("the angle", "torque")
    assert found.probability > 0.9
    assert found.closed > 0.8
    law = found.law
    assert law is not None
    assert law.family.name == "saturation"
    assert law.values["at"] * found.variable.reference == pytest.approx(FROM_RAD, abs=0.01)
    slope_Nm = law.amplitude * found.form.weights[0] / found.variable.reference
    assert slope_Nm == pytest.approx(-STIFFNESS_NM, rel=0.1)


def test_a_bench_as_the_model_says_depends_on_nothing(model):
    assert found_on(model, model) is None
