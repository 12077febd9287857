"""The paper's bench cases (Figs 26 to 28) as a model study: a planar prototype's numbers.

The absolute degrees follow from assumed inertias and gains; a match with the figures is not
claimed. What is held: the prototype's peaks, residuals and rebounds where they stand out of
friction and noise, and what distinguishes the controllers.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest

from benchtool.report.flight.pitch_study import pitch_study
from benchtool.simulate.inputs import PitchInputs
from benchtool.simulate.pitch.setup import pitch_setup
from benchtool.simulate.pitch.simulate import PlateVisitMeasures, measure_plate_visit

SETS = {
    "soft": ("s3", {}),
    "slow integral": ("s3", {"gains.attitude.k_i_theta_per_s2": 0.5}),
    "stiff": ("stiff", {}),
}


@lru_cache
def numbers(rig: str, gains: str, controller: str, friction: float = 1.0) -> PlateVisitMeasures:
    """Return the medians over five seeds."""
    name, values = SETS[gains]
    inputs = PitchInputs(rig=rig, controllers=(controller,))
    setup = pitch_setup(inputs, name).with_changes(values)
    if friction != 1.0:
        held = setup.bench.model.parameters["coulomb_friction.torque_Nm"].value
        setup = setup.with_changes({"coulomb_friction.torque_Nm": friction * held})
    found = []
    for seed in range(5):
        run = pitch_study(setup, seed).runs[0]
        found.append(measure_plate_visit(run, setup.schedule.plate[0], setup.schedule.duration_s))
    return PlateVisitMeasures(
        **{
            field: float(np.median([getattr(each, field) for each in found]))
            for field in PlateVisitMeasures.__slots__
        }
    )


@pytest.mark.parametrize(
    ("rig", "gains", "peak_deg", "residual_deg", "rebound_deg"),
    [
        ("pquad", "soft", 1.66, -1.65, 0.0),
        ("pquad", "slow integral", 1.34, -0.10, 1.57),
        ("pquad", "stiff", 0.49, -0.01, 0.45),
        ("amuse", "soft", 0.65, -0.64, 0.0),
        ("amuse", "slow integral", 0.50, -0.03, 0.53),
        ("amuse", "stiff", 0.18, -0.02, 0.17),
    ],
)
def test_the_pid_alone(rig, gains, peak_deg, residual_deg, rebound_deg):
    found = numbers(rig, gains, "pid")
    assert np.degrees(found.peak_rad) == pytest.approx(-peak_deg, rel=0.15)
    assert np.degrees(found.residual_rad) == pytest.approx(residual_deg, rel=0.12, abs=0.05)
    assert np.degrees(found.rebound_rad) == pytest.approx(rebound_deg, rel=0.12, abs=0.02)


def test_the_opposite_bump_needs_an_integral_or_an_observer():
    assert numbers("pquad", "soft", "pid").rebound_rad == 0.0
    assert np.degrees(numbers("pquad", "slow integral", "pid").rebound_rad) > 1.0
    assert np.degrees(numbers("pquad", "soft", "observer").rebound_rad) == pytest.approx(
        0.25, abs=0.06
    )
