"""A leaning plate, seen by rotors away from its centre."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.rig_file import rig_named
from benchtool.physics.conditions import Conditions
from benchtool.physics.images import single_rotor_factor
from benchtool.physics.model import Model


def factors(rig_name: str, plate_x_m: float, angle_rad: float) -> np.ndarray:
    """Return each disc's T_IGE/T_OGE over a large plate 0.2 m away, wholly covered."""
    rig = rig_named(rig_name)
    model = Model.single(rig).with_effect("plate_tilt", angle_rad=angle_rad)
    conditions = Conditions.of(
        rig,
        speed_rad_s=np.full(rig.n_rotors, 500.0),
        plate_z_m=np.array([0.2]),
        plate_x_m=plate_x_m,
        coverage=np.ones((rig.n_discs, 1)),
    )
    values = model.parameters.values_array()
    return np.ravel(model.disc_factors(model.flow(conditions, values), values))


@pytest.mark.parametrize("plate_x_m", [0.0, 0.3, -0.3])
def test_a_single_rotor_sees_tilt_only_through_the_plates_lateral_position(
    plate_x_m: float,
) -> None:
    height_m = 0.2 * np.cos(0.1) + plate_x_m * np.sin(0.1)
    expected = single_rotor_factor(0.12, height_m)
    assert factors("pquad_single", plate_x_m, 0.1) == pytest.approx([expected])


def test_a_positive_tilt_brings_the_front_rotor_nearer() -> None:
    front, left, rear, right = factors("pquad", 0.0, 0.1)
    assert front > left > rear
    assert left == pytest.approx(right)
