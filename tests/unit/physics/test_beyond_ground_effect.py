"""Effects of neighbours, rooms and Reynolds numbers against what their sources state."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.rig_file import rig_named
from benchtool.physics.bases import factor_at
from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model


def test_neighbours_far_from_every_surface_take_thrust_only_while_they_turn():
    rig = rig_named("pquad")
    model = Model.single(rig).with_effect("rotor_interaction", share=0.02, reach=0.3)
    k = model.parameters["k"].value
    far = {"plate_z_m": [1e6], "coverage": np.zeros((4, 1))}
    alone = Conditions.of(rig, speed_rad_s=[500.0, 0.0, 0.0, 0.0], **far)
    together = Conditions.of(rig, speed_rad_s=[500.0] * 4, **far)
    assert model.thrust_N(alone)[0] == pytest.approx(k * 500.0**2, rel=1e-12)
    distances = rig.disc_distances_m[0, 1:] / (2.0 * rig.propulsion.radius_m)
    lost = 0.02 * np.exp(-(distances - 1.0) / 0.3).sum()
    assert model.thrust_N(together)[0] == pytest.approx(4.0 * k * 500.0**2 * (1.0 - lost))


def test_a_room_takes_seven_per_cent_at_two_and_a_half_radii_and_none_far_away():
    rig = rig_named("pquad_single")
    bare, model = Model.single(rig), Model.single(rig).with_effect("recirculation", share=0.07)
    z_m = np.array([0.5, 1.5, 2.5, 4.0, 60.0]) * rig.propulsion.radius_m
    at = Conditions.of(rig, speed_rad_s=[500.0], plate_z_m=z_m, coverage=np.ones((1, 5)))
    left = model.thrust_N(at) / bare.thrust_N(at)
    assert left[2] == pytest.approx(0.93)
    assert np.all(left[[0, 1, 3]] > 0.93)
    assert left[4] == pytest.approx(1.0, abs=1e-6)


def test_forward_speed_washes_the_ground_effect_out_as_the_source_prints_it():
    rig = rig_named("pquad_single")
    model = Model.single(rig).with_effect("forward_speed", strength=1.0, hover_inflow_m_s=5.0)
    speeds = np.array([0.0, 2.0, 5.0, 20.0])
    z_m = np.full(4, rig.propulsion.radius_m)
    moving = Conditions.of(rig, speed_rad_s=[500.0], plate_z_m=z_m, airspeed_m_s=speeds)
    inflow = np.sqrt(
        [next(v.real for v in np.roots([1.0, V**2, -(5.0**4)]) if v.real > 0) for V in speeds]
    )
    expected = 1.0 / (1.0 - (1.0 / 16.0) / (1.0 + (speeds / inflow) ** 2))
    np.testing.assert_allclose(factor_at(model, "equal_rpm2", moving), expected, rtol=1e-12)
    assert expected[0] == pytest.approx(16.0 / 15.0)
    assert expected[-1] < 1.001
