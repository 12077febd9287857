"""A user's own controller: the same loop, stopped at every tick."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchtool.core.errors import InputError
from benchtool.simulate.controllers.controller import PitchCommand, PitchMeasurement, PitchReference
from benchtool.simulate.pitch.simulate import simulate_controller, simulate_pitch
from tests.unit.simulate.pitching import STEADY_PLATE, SWAY, job, noisy_bench, sampled, soft


class Cascade:
    """The published attitude law, as somebody would write it."""

    def step(
        self, measurement: PitchMeasurement, reference: PitchReference, dt_s: float
    ) -> PitchCommand:
        assert dt_s == 0.002
        rate = 2.9 * (reference.theta_rad - measurement.theta_rad)
        return PitchCommand(0.018 * 7.4 * (rate - measurement.rate_rad_s))


class Returns:
    """Return always the same."""

    def __init__(self, what: Any) -> None:
        self.what = what

    def step(self, measurement: PitchMeasurement, reference: PitchReference, dt_s: float) -> Any:
        return self.what


SCHEDULE = sampled(1.0, reference_deg=SWAY, plate=STEADY_PLATE)


def test_the_same_law_in_python_gives_the_same_run():
    own = simulate_controller(Cascade(), job(noisy_bench(), soft()), SCHEDULE, seed=2)
    built_in = simulate_pitch(job(noisy_bench(), soft()), SCHEDULE, seed=2)
    np.testing.assert_allclose(own.log, built_in.log, rtol=1e-12, atol=1e-15)


@pytest.mark.parametrize(
    ("what", "message"),
    [
        (float("nan"), "returned torque_Nm = nan at 0 s"),
        (None, "returned torque_Nm = None"),
        ("0.1", "returned torque_Nm = '0.1'"),
        (PitchCommand(0.0, float("inf")), "returned difference_us = inf"),
        ((0.1, 0.0, 0.0), r"returned a command = \(0.1, 0.0, 0.0\)"),
        (np.zeros(2), r"returned torque_Nm = array\(\[0., 0.\]\)"),
    ],
)
def test_what_is_no_finite_number_is_refused_with_file_and_line(what, message):
    with pytest.raises(InputError, match=message + r".* in .*test_pitch_own_controller\.py line"):
        simulate_controller(Returns(what), job(noisy_bench(), soft()), SCHEDULE)
