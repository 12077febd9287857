"""A leaning plate: commanded or unnoticed it pivots about its own centre."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.rig_file import rig_named
from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model


def over_a_plate(model: Model, **place: float) -> Conditions:
    """Return all rotors turning over a large plate 0.2 m away, wholly covered."""
    return Conditions.of(
        model.rig,
        speed_rad_s=np.full(model.rig.n_rotors, 500.0),
        plate_z_m=np.array([0.2]),
        coverage=np.ones((model.rig.n_discs, 1)),
        **place,
    )


def factors(model: Model, **place: float) -> np.ndarray:
    """Return each disc's T_IGE/T_OGE there."""
    values = model.parameters.values_array()
    return np.ravel(model.disc_factors(model.flow(over_a_plate(model, **place), values), values))


@pytest.mark.parametrize("plate_x_m", [0.0, 0.3, -0.3])
def test_a_single_rotor_sees_tilt_through_the_plates_lateral_position_and_its_cosine(plate_x_m):
    height_m = 0.2 * np.cos(0.1) + plate_x_m * np.sin(0.1)
    expected = 1.0 / (1.0 - np.cos(0.1) * (0.12 / (4.0 * height_m)) ** 2)
    model = Model.single(rig_named("pquad_single")).with_effect("plate_tilt", angle_rad=0.1)
    assert factors(model, plate_x_m=plate_x_m) == pytest.approx([expected])


@pytest.mark.parametrize("plate_x_m", [0.0, 0.3, -0.3])
@pytest.mark.parametrize("commanded_rad", [0.0, 0.04])
def test_a_commanded_tilt_and_the_effect_pivot_about_one_point(plate_x_m, commanded_rad):
    whole, model = np.radians(5.0), load_model("quad_body_lift").model
    told = factors(model, plate_x_m=plate_x_m, plate_tilt_rad=whole)
    unnoticed = model.with_effect("plate_tilt", angle_rad=whole - commanded_rad)
    shown = factors(unnoticed, plate_x_m=plate_x_m, plate_tilt_rad=commanded_rad)
    np.testing.assert_allclose(shown, told, rtol=1e-14)
