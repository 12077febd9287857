"""What a stand in the wake takes, far from the plate and near it."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.rig_file import rig_named
from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model

RIG = rig_named("pquad_single")
RADIUS_M = RIG.propulsion.radius_m


def taken(z_over_R: float, coverage: float = 1.0) -> float:
    """Return the share of thrust that a stand of 10 % takes there."""
    bare = Model.single(RIG)
    conditions = Conditions.of(
        RIG,
        speed_rad_s=np.array([400.0]),
        plate_z_m=np.array([z_over_R * RADIUS_M]),
        coverage=np.array([[coverage]]),
    )
    with_stand = bare.with_effect("wall_blockage", share=0.1)
    return float(1.0 - with_stand.thrust_N(conditions)[0] / bare.thrust_N(conditions)[0])


@pytest.mark.parametrize(
    ("z_over_R", "ratio"), [(0.5, 0.26003), (1.0, 0.55119), (2.0, 0.83489), (4.0, 0.97766)]
)
def test_near_the_plate_it_is_the_recovery_of_leishmans_formula(z_over_R, ratio):
    """Worked out by hand: 1 - 1.22 exp(-z/R)."""
    assert taken(z_over_R) == pytest.approx(0.1 * ratio, rel=1e-4)


def test_beside_the_plate_nothing_is_recovered():
    assert taken(0.5, coverage=0.0) == pytest.approx(0.1)
    assert taken(0.5, coverage=0.5) == pytest.approx(0.5 * (0.1 + taken(0.5)), rel=0.1)
