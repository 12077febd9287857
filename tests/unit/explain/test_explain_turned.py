"""Recordings without pulses: the plant turns as its rotors were measured."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.explain.engine.evidence import EARLY, LATE, RowGroups
from benchtool.explain.engine.explain import explain, locate_gap
from benchtool.explain.inputs import ExplainInputs
from benchtool.explain.pitch.log import PitchLog, pitch_log
from benchtool.explain.pitch.subject import PitchSubject
from benchtool.explain.result import Explanation
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model
from benchtool.simulate.pitch.filter_log import filter_log
from tests.unit.explain.pitch_made import recorded, without

BEFORE_SPEED = ("motor_lag", "transport_delay", "battery_sag")  # effects between pulse and speed


@pytest.fixture(scope="module")
def model():
    return load_model("pitch_beam").model.with_fixed("coulomb_friction.torque_Nm", 0.0)


def turned(truth: Model, seed: int) -> PitchLog:
    return pitch_log(without(recorded(truth, seed), r"pwm\d_us"), truth.rig, f"seed {seed}")


def judged(model: Model, truth: Model) -> Explanation:
    subject = PitchSubject(model, [turned(truth, 1)], [turned(truth, 2)])
    return explain(subject, ExplainInputs(draws=32))


def test_what_lies_before_the_speeds_is_never_named(model):
    truth = model.with_effect("battery_sag", rate_per_s=0.004).with_fixed("motor_lag.tau_s", 0.04)
    verdict = judged(model, truth)
    assert verdict.kind == "none"
    assert set(BEFORE_SPEED) <= set(verdict.not_judged)


def test_rotors_pass_through_every_measured_speed(model):
    log = turned(model.with_fixed("motor_lag.tau_s", 0.035), 3).logged
    assert log.from_speeds
    subject = PitchSubject(model, [turned(model, 1)], [turned(model, 2)])
    bench = subject.evidence.bench(np.zeros(len(subject.evidence.parameters)), log.rate_Hz)
    found = filter_log([bench], log, np.zeros(7)).speed_rad_s[:, :, 0].T
    p = model.rig.propulsion
    measured = (log.pwm_us - p.pwm_start_us) * p.speed_per_us_rad_s
    np.testing.assert_allclose(found, measured, rtol=1e-6)


N = 900
TIME = np.arange(N)


@pytest.mark.parametrize(
    ("gained", "regime"),
    [
        (TIME >= 600, "high collective"),  # both begin together: the collective says more
        ((TIME >= 600) & (TIME < 700), "high collective"),
        (TIME >= 750, LATE),  # the high collective ends before it is worst
        (TIME < 300, EARLY),
    ],
)
def test_the_clock_is_named_only_where_nothing_else_fits_about_as_well(gained, regime):
    groups = RowGroups(
        stages={"hinge": np.ones(N, bool)},
        regimes={
            LATE: TIME >= 600,
            EARLY: TIME < 300,
            "high collective": (TIME >= 590) & (TIME < 790),
            "plate in": TIME % 2 == 0,
        },
    )
    before = np.where(gained, 3.0, 1.0)
    found = locate_gap(groups, before, np.ones(N), "hinge")
    assert found is not None
    assert (found.stage, found.regime) == ("hinge", regime)
