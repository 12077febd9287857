"""Heights of a tilted vehicle, and where the formulae hold."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchtool.core.rig_file import rig_named
from benchtool.physics import VALIDITY_Z_OVER_R
from benchtool.physics.model import Model
from benchtool.physics.validity import clamped_height
from benchtool.simulate.pitch.attitude import tilted_vehicle_height
from tests.unit.physics.general_sum import pole_z_over_R

angles = st.floats(-0.4, 0.4)
places = st.floats(-0.4, 0.4)


@given(places, places, angles, angles)
def test_height_of_a_tilted_vehicle_is_that_of_the_rotated_place(
    x: float, y: float, pitch: float, roll: float
) -> None:
    about_y = np.array(
        [[np.cos(pitch), 0, np.sin(pitch)], [0, 1, 0], [-np.sin(pitch), 0, np.cos(pitch)]]
    )
    about_x = np.array(
        [[1, 0, 0], [0, np.cos(roll), -np.sin(roll)], [0, np.sin(roll), np.cos(roll)]]
    )
    place = about_y @ about_x @ np.array([x, y, 0.0])
    assert tilted_vehicle_height(0.4, x, y, pitch, roll) == pytest.approx(0.4 + place[2], abs=1e-14)


def test_nose_down_brings_the_front_rotor_nearer() -> None:
    assert tilted_vehicle_height(0.24, 0.225, 0.0, 0.1, 0.0) == pytest.approx(
        0.24 - 0.225 * np.sin(0.1), rel=1e-15
    )
    assert tilted_vehicle_height(0.24, 0.0, 0.225, 0.0, 0.1) > 0.24


def test_heights_below_the_limit_are_clamped() -> None:
    z = np.array([0.01, 0.0599, 0.06, 0.5])
    np.testing.assert_array_equal(clamped_height(z, 0.5 * 0.12), [0.06, 0.06, 0.06, 0.5])
    assert Model.single(rig_named("pquad")).nearest_z_over_R == VALIDITY_Z_OVER_R == 0.5


def test_the_limit_is_above_every_pole_of_the_paper_s_vehicles() -> None:
    for radius, d in ((0.12, 0.27), (0.12, 0.318), (0.205, 0.60)):
        h = 0.5 * d
        square = np.array([[h, h], [-h, h], [-h, -h], [h, -h]])
        assert 0.25 < pole_z_over_R(radius, square, 2.0) < 0.6 * VALIDITY_Z_OVER_R


def test_coincident_rotors_have_their_pole_at_the_upper_bound() -> None:
    assert pole_z_over_R(0.1, np.zeros((4, 2))) == pytest.approx(0.5, rel=1e-12)
    assert pole_z_over_R(0.1, np.zeros((1, 2)), 3.0) == pytest.approx(0.5, rel=1e-12)
