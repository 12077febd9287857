"""Plate tilt, minimum distance and wake rules."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics import VALIDITY_Z_OVER_R
from benchtool.physics.body_lift import WAKE_RULES, wake_rule
from benchtool.physics.conditions import Conditions
from benchtool.physics.images import axis_cosine, clamped_height, height_over, plate_plane
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model


def over_plate(model: Model, **position: float) -> Conditions:
    """Return conditions with all rotors running over a large plate at 0.2 m, fully covered."""
    return Conditions.build(
        model.rig,
        speed_rad_s=np.full(model.rig.n_rotors, 500.0),
        plate_z_m=np.array([0.2]),
        coverage=np.ones((model.rig.n_discs, 1)),
        **position,
    )


def factors(model: Model, **position: float) -> np.ndarray:
    """Return T_IGE/T_OGE of each disc under those conditions."""
    values = model.parameters.values_array()
    return np.ravel(model.disc_factors(model.flow(over_plate(model, **position), values), values))


@pytest.mark.parametrize("plate_x_m", [0.0, 0.3, -0.3])
def test_tilt_changes_a_single_rotor_by_lateral_position_and_cosine(plate_x_m):
    height_m = 0.2 * np.cos(0.1) + plate_x_m * np.sin(0.1)
    expected = 1.0 / (1.0 - np.cos(0.1) * (0.12 / (4.0 * height_m)) ** 2)
    model = Model.single(load_rig_by_name("pquad_single")).with_effect("plate_tilt", angle_rad=0.1)
    assert factors(model, plate_x_m=plate_x_m) == pytest.approx([expected])


@pytest.mark.parametrize("plate_x_m", [0.0, 0.3, -0.3])
@pytest.mark.parametrize("commanded_rad", [0.0, 0.04])
def test_a_commanded_tilt_and_the_effect_pivot_about_one_point(plate_x_m, commanded_rad):
    tilt_rad, model = np.radians(5.0), load_model("quad_body_lift").model
    expected = factors(model, plate_x_m=plate_x_m, plate_tilt_rad=tilt_rad)
    tilted = model.with_effect("plate_tilt", angle_rad=tilt_rad - commanded_rad)
    actual = factors(tilted, plate_x_m=plate_x_m, plate_tilt_rad=commanded_rad)
    np.testing.assert_allclose(actual, expected, rtol=1e-14)


angles = st.floats(-0.4, 0.4)
positions = st.floats(-0.4, 0.4)


@given(positions, positions, positions, angles)
def test_a_plate_pivots_about_its_own_centre(x, y, plate_x, tilt):
    """The distance from a disc to the plane through (plate_x, 0, -z) with the tilted normal."""
    plane = plate_plane(0.4, plate_x, tilt)
    normal = np.array([-np.sin(tilt), 0.0, np.cos(tilt)])
    expected = normal @ (np.array([x, y, 0.0]) - np.array([plate_x, 0.0, -0.4]))
    assert height_over(plane, x, y) == pytest.approx(expected, abs=1e-14)
    assert axis_cosine(plane) == pytest.approx(np.cos(tilt), rel=1e-14)


def test_heights_below_the_limit_are_clamped():
    z = np.array([0.01, 0.0599, 0.06, 0.5])
    np.testing.assert_array_equal(clamped_height(z, 0.5 * 0.12), [0.06, 0.06, 0.06, 0.5])
    assert Model.single(load_rig_by_name("pquad")).nearest_z_over_R == VALIDITY_Z_OVER_R == 0.5


@pytest.mark.parametrize("name", sorted(WAKE_RULES))
@pytest.mark.parametrize("n", [2, 3, 4, 8])
def test_all_discs_covered_is_equation_4(name, n):
    assert wake_rule(name)(np.ones(n)) == pytest.approx(1.0, rel=1e-15)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("notes", 2 / 3), ("full", 1.0), ("mean", 0.75), ("product", 0.0), ("pairs", 0.5)],
)
def test_three_of_four(name, expected):
    assert wake_rule(name)(np.array([1.0, 1.0, 0.0, 1.0])) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("notes", 0.0), ("full", 1.0), ("mean", 0.25), ("product", 0.0), ("pairs", 0.0)],
)
def test_one_of_four(name, expected):
    assert wake_rule(name)(np.array([1.0, 0.0, 0.0, 0.0])) == pytest.approx(expected)
