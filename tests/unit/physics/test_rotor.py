"""Thrust and drag against speed, speed against pulse width and voltage."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.rotor import (
    WRENCH,
    drag_torque_Nm,
    ground_effect_thrust_N,
    mixer_matrix,
    pitch_moment_Nm,
    pwm_from_speed,
    speed_from_pwm,
    speed_from_thrust,
    thrust_N,
)

speeds = st.floats(0.0, 3000.0)


@given(speeds, st.floats(1.0, 2.0))
def test_thrust_and_drag_grow_with_the_square(speed, factor):
    assert thrust_N(speed, 1e-5) == pytest.approx(1e-5 * speed**2)
    assert drag_torque_Nm(speed, 2e-7) == pytest.approx(2e-7 * speed**2)
    assert ground_effect_thrust_N(speed, 1e-5, factor) == pytest.approx(
        factor * thrust_N(speed, 1e-5)
    )
    assert speed_from_thrust(thrust_N(speed, 1e-5), 1e-5) == pytest.approx(speed, abs=1e-9)


def test_speed_follows_pulse_and_voltage():
    pwm = np.array([900.0, 1100.0, 1101.0, 1600.0])
    np.testing.assert_allclose(speed_from_pwm(pwm, 1.5, 1100.0, 14.8, 14.8), [0, 0, 1.5, 750])
    np.testing.assert_allclose(speed_from_pwm(pwm, 1.5, 1100.0, 7.4, 14.8), [0, 0, 0.75, 375])


@given(st.floats(1100.0, 2000.0), st.floats(9.0, 18.0))
def test_pulse_width_is_the_inverse(pwm, voltage):
    speed = speed_from_pwm(pwm, 1.3, 1100.0, voltage, 14.8)
    assert pwm_from_speed(speed, 1.3, 1100.0, voltage, 14.8) == pytest.approx(pwm, rel=1e-12)


K, C, ARM = 1.2e-5, 1.8e-7, 0.225


ROWS = {row: number for number, row in enumerate(WRENCH)}


def test_moments_are_arm_times_force(rng):
    """Compare with the cross product r x F and with drag opposing the spin."""
    n = 7
    x, y = rng.uniform(-0.5, 0.5, (2, n))
    spin = rng.choice([-1.0, 1.0], n)
    squares = rng.uniform(1e4, 1e6, n)
    positions = np.stack([x, y, np.zeros(n)], axis=1)
    forces = np.stack([np.zeros(n), np.zeros(n), K * squares], axis=1)
    torque = np.cross(positions, forces).sum(axis=0)
    torque[2] += -(spin * C * squares).sum()
    got = mixer_matrix(x, y, spin, K, C) @ squares
    np.testing.assert_allclose(got, [forces[:, 2].sum(), *torque], rtol=1e-12)
    assert pitch_moment_Nm(K * squares, x) == pytest.approx(torque[1], rel=1e-12)


@pytest.mark.parametrize(
    ("row", "signs"),
    [
        ("thrust_N", {"front": 1, "left": 1, "rear": 1, "right": 1}),
        ("roll_Nm", {"front": 0, "left": 1, "rear": 0, "right": -1}),
        ("pitch_Nm", {"front": -1, "left": 0, "rear": 1, "right": 0}),
        ("yaw_Nm", {"front": -1, "left": 1, "rear": -1, "right": 1}),
    ],
)
@pytest.mark.parametrize(("rig_name", "ring"), [("pquad", ""), ("amuse", "_upper")])
def test_all_rows_for_the_vehicles_of_the_paper_are_equation_9(rig_name, ring, row, signs):
    """Axes x forward, y left, z up, rotor 1 in front; of coaxial pairs the upper rotors."""
    rig = load_rig_by_name(rig_name)
    rotors = [rotor for rotor in rig.rotors if rotor.name.endswith(ring)]
    assert [rotor.name.removesuffix(ring) for rotor in rotors] == list(signs)
    x, y, spin = (
        np.array([getattr(rotor, key) for rotor in rotors], float) for key in ("x_m", "y_m", "spin")
    )
    propulsion = rig.propulsion
    k, c = propulsion.thrust_coefficient_N_s2, propulsion.drag_coefficient_Nm_s2
    scale = {"thrust_N": k, "yaw_Nm": c}.get(row, k * float(np.hypot(x, y)[0]))
    printed = scale * np.array([*signs.values()], float)
    np.testing.assert_allclose(mixer_matrix(x, y, spin, k, c)[ROWS[row]], printed, atol=1e-20)
