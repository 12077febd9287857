"""Model against closed formulas for the layouts of the paper."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.channel import Channel
from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.bases import ground_effect_ratio
from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.partial_coverage import factors
from benchtool.physics.model import Model
from benchtool.physics.model_file import load_model
from tests.unit.physics.closed_forms import quad_body_lift_factor, quad_factor, single_rotor_factor

Z_M = np.array([0.06, 0.12, 0.18, 0.24, 0.36, 0.6])
SPEEDS = np.full((4, 1), 576.0)


def test_the_model_of_the_quadrotor_is_eq_2_3_and_4():
    rig = load_rig_by_name("pquad")
    radius, spacing = rig.propulsion.radius_m, rig.disc_distances_m[0, 1]
    conditions = Conditions.build(rig, speed_rad_s=SPEEDS, plate_z_m=Z_M)
    single = Model.single(rig)
    quad = single.with_effect("neighbour_images")
    lifted = quad.with_effect("body_lift", K_b=2.0)
    half = spacing / np.sqrt(2.0)
    for model, expected in (
        (single, single_rotor_factor(radius, Z_M)),
        (quad, quad_factor(radius, Z_M, spacing)),
        (lifted, quad_body_lift_factor(radius, Z_M, spacing, half, 2.0)),
    ):
        np.testing.assert_allclose(
            ground_effect_ratio(model, "equal_rpm2", conditions), expected, rtol=1e-12
        )
        thrust = 4.0 * rig.propulsion.thrust_coefficient_N_s2 * 576.0**2 * expected
        np.testing.assert_allclose(model.thrust_N(conditions), thrust, rtol=1e-12)


def test_coaxial_rotors_count_as_one_disc():
    rig = load_rig_by_name("amuse")
    z = np.array([1.0, 2.0]) * rig.propulsion.radius_m
    conditions = Conditions.build(rig, speed_rad_s=np.full((8, 1), 400.0), plate_z_m=z)
    model = Model.single(rig).with_effect("neighbour_images")
    expected = quad_factor(rig.propulsion.radius_m, z, rig.disc_distances_m[0, 1])
    np.testing.assert_allclose(
        ground_effect_ratio(model, "equal_rpm2", conditions), expected, rtol=1e-12
    )
    assert model.thrust_N(conditions)[0] == pytest.approx(
        8 * rig.propulsion.thrust_coefficient_N_s2 * 400.0**2 * expected[0]
    )


def test_area_factors_follow_their_shares():
    assert factors([0.25, 1.0 / 3.0, 0.5]) == pytest.approx((0.25, 0.5, 0.75))
    model = load_model("partial_area").model
    radius = model.rig.propulsion.radius_m
    shares = {f"partial_coverage.share_{k + 1}": v for k, v in enumerate((0.5, 0.2, 0.5))}
    for name, value in shares.items():
        model = model.with_fixed(name, value)
    conditions = Conditions.build(
        model.rig,
        speed_rad_s=np.array([576.0]),
        plate_z_m=np.full(3, radius),
        coverage=np.array([[0.25, 0.5, 0.75]]),
    )
    increment = ground_effect_ratio(model, "equal_rpm2", conditions) - 1.0
    full = single_rotor_factor(radius, radius) - 1.0
    np.testing.assert_allclose(increment / full, factors([0.5, 0.2, 0.5]), rtol=1e-12)


def test_effects_on_speed_apply_only_to_speeds_that_were_not_measured():
    rig = load_rig_by_name("pquad")
    model = Model.single(rig).with_effect("battery_sag", rate_per_s=0.001)
    common = {"speed_rad_s": SPEEDS, "plate_z_m": Z_M, "time_s": 100.0}
    measured = Conditions.build(rig, **common)
    commanded = Conditions.build(rig, **common, speed_measured=False)
    np.testing.assert_allclose(
        model.thrust_N(commanded), 0.81 * model.thrust_N(measured), rtol=1e-12
    )


def test_conditions_use_rpm_or_else_pulse_widths():
    rig = load_rig_by_name("pquad_single")
    pulse = Channel("pwm1_us", "pwm_us")
    rpm = Channel("rpm1", "rpm")
    z = (Channel("plate_z_m", "m"), np.array([0.12, 0.24]))
    by_pulse = Conditions.from_recording(
        Recording.from_columns([(pulse, np.array([1500.0, 1600.0])), z]), rig
    )
    by_rpm = Conditions.from_recording(
        Recording.from_columns([(rpm, np.array([4000.0, 5000.0])), z]), rig
    )
    gain = rig.propulsion.speed_per_us_rad_s
    assert by_pulse.speed_rad_s[0] == pytest.approx([450.0 * gain, 550.0 * gain])
    assert not by_pulse.speed_measured
    assert by_rpm.speed_rad_s[0] == pytest.approx(np.array([4000.0, 5000.0]) * np.pi / 30.0)
    assert by_rpm.speed_measured
    with pytest.raises(InputError, match="neither rotor speed nor pulse width"):
        Conditions.from_recording(Recording.from_columns([z]), rig)
