"""The whole chain on benches that we simulate: named, none, unknown, the model that comes out."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.explain.engine.explain import explain
from benchtool.explain.inputs import ExplainInputs
from benchtool.explain.pitch.evidence import PitchEvidence
from benchtool.explain.pitch.log import PitchLog, pitch_log
from benchtool.explain.pitch.next_experiment import PitchDesigner
from benchtool.explain.pitch.subject import PitchSubject
from benchtool.explain.result import Explanation
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model
from tests.unit.explain.hand_made import far_off
from tests.unit.explain.pitch_made import recorded


@pytest.fixture(scope="module")
def model():
    return load_model("pitch_beam").model.with_fixed("coulomb_friction.torque_Nm", 0.0)


def log_of(truth: Model, seed: int) -> PitchLog:
    return pitch_log(recorded(truth, seed), truth.rig, f"seed {seed}")


def explained(model: Model, truth: Model) -> Explanation:
    subject = PitchSubject(model, [log_of(truth, 1)], [log_of(truth, 2)])
    return explain(subject, ExplainInputs(draws=32))


@pytest.fixture(scope="module")
def friction(model):
    return explained(model, model.with_fixed("coulomb_friction.torque_Nm", 0.011))


@pytest.mark.slow
def test_hidden_friction_is_named_with_its_size(friction):
    verdict = friction
    assert (verdict.kind, verdict.names) == ("effect", ("coulomb_friction",))
    found = verdict.effects[0].parameters[0]
    assert found.low <= 0.011 <= found.high
    assert found.std < 0.0016  # 0.0011 of it because a law may be off by 10 %
    assert verdict.effects[0].probability > 0.9
    assert verdict.effects[0].p_value < 1e-6
    assert verdict.where is not None
    assert verdict.where.stage == "hinge"
    assert "lacks Coulomb friction: coulomb_friction.torque_Nm = 0.01" in verdict.sentence


def test_small_imperfections_are_nothing(model):
    truth = (
        model.with_fixed("coulomb_friction.torque_Nm", 0.0006)
        .with_effect("cog_offset", x_m=0.0002)
        .with_effect("gyro_bias", bias_rad_s=0.001)
        .with_effect("rotor_asymmetry", ratio=1.004)
        .with_effect("speed_map", gain=0.002, difference=-0.003, bend=0.015)
        .with_effect("lag_shape", with_speed=0.2, rising=0.02)
        .with_effect("gyro_lag", late_s=0.0006)
    )
    verdict = explained(model, truth)
    assert verdict.kind == "none"
    assert verdict.effects == ()
    assert all(gap.after == gap.before for gap in verdict.gaps)
    assert verdict.probabilities["none"] > 0.8


@pytest.mark.slow
def test_what_is_unknown_between_pulse_and_speed_asks_for_a_ladder_of_pulses(model):
    evidence = PitchEvidence(model, [log_of(model, 1).logged])
    pair = [far_off(evidence, name, 5.0) for name in ("motor_lag", "battery_sag")]
    designer = PitchDesigner(evidence, pair, np.random.default_rng(1))
    chosen = designer.propose("pwm_to_rpm", None)
    assert "the ESC's mode" in chosen.reason
    assert chosen.schedule is not None
    assert len(set(chosen.schedule.collective[0].levels)) == 5
    assert 1.3 in [visit.z_over_R for visit in chosen.schedule.plate]
