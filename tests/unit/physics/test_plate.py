"""Heights over a tilted plate, and where the formulae hold."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchtool.physics.plate import rotor_heights_m, tilted_plate_height, tilted_vehicle_height
from benchtool.physics.validity import (
    VALIDITY_Z_OVER_R,
    clamped_height,
    count_clamped,
    pole_z_over_R,
)

angles = st.floats(-0.4, 0.4)
places = st.floats(-0.4, 0.4)


@given(places, places, angles, angles)
def test_distance_to_a_tilted_plate_is_that_to_its_nearest_point(
    x: float, y: float, tilt_y: float, tilt_x: float
) -> None:
    """Find the plate's nearest point below the rotor, by least squares along the plate's edges.

    The plate faces up to its normal, which leans to -x and -y where +x and +y come nearer.
    """
    z = 0.7
    normal = np.array(
        [-np.sin(tilt_y) * np.cos(tilt_x), -np.sin(tilt_x), np.cos(tilt_y) * np.cos(tilt_x)]
    )
    edges = np.linalg.svd(normal[None, :])[2][1:].T
    from_plate = np.array([x, y, z])
    along = np.linalg.lstsq(edges, from_plate, rcond=None)[0]
    nearest = np.linalg.norm(from_plate - edges @ along)
    assert tilted_plate_height(z, x, y, tilt_y, tilt_x) == pytest.approx(nearest, rel=1e-9)


def test_one_tilt_is_z_cos_minus_x_sin() -> None:
    got = tilted_plate_height(0.3, 0.2, 0.9, 0.1, 0.0)
    assert got == pytest.approx(0.3 * np.cos(0.1) - 0.2 * np.sin(0.1), rel=1e-15)
    assert tilted_plate_height(0.3, 0.2, 0.0, 0.1, 0.0) < 0.3 < 0.3 / np.cos(0.1)
    assert tilted_plate_height(0.3, 0.0, 0.2, 0.0, 0.1) < tilted_plate_height(0.3, 0, -0.2, 0, 0.1)


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


def test_heights_of_all_rotors_go_along_with_samples() -> None:
    z = np.array([0.1, 0.2, 0.3])
    heights = np.array(rotor_heights_m(z, [0.2, 0.0, -0.2], [0.0, 0.1, 0.0], 0.05))
    assert heights.shape == (3, 3)
    np.testing.assert_allclose(heights[1], z * np.cos(0.05))
    np.testing.assert_allclose(heights[2] - heights[0], 0.4 * np.sin(0.05))
    np.testing.assert_allclose(rotor_heights_m(z, [0.2], [0.1]), [z])


def test_heights_below_the_limit_are_clamped_and_counted() -> None:
    z = np.array([0.01, 0.0599, 0.06, 0.5])
    np.testing.assert_array_equal(clamped_height(z, 0.12), [0.06, 0.06, 0.06, 0.5])
    assert count_clamped(z, 0.12) == 2
    assert count_clamped(0.01, 0.12) == 1
    assert clamped_height(0.0, 1.0) == VALIDITY_Z_OVER_R


def test_the_limit_is_above_every_pole_of_the_paper_s_vehicles() -> None:
    for radius, d in ((0.12, 0.27), (0.12, 0.318), (0.205, 0.60)):
        h = 0.5 * d
        square = np.array([[h, h], [-h, h], [-h, -h], [h, -h]])
        assert 0.25 < pole_z_over_R(radius, square, 2.0) < 0.6 * VALIDITY_Z_OVER_R


def test_coincident_rotors_have_their_pole_at_the_upper_bound() -> None:
    assert pole_z_over_R(0.1, np.zeros((4, 2))) == pytest.approx(0.5, rel=1e-12)
    assert pole_z_over_R(0.1, np.zeros((1, 2)), 3.0) == pytest.approx(0.5, rel=1e-12)
