"""The attitude loop: its stiffness, its limits, and integrals that neither wind up nor bump."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.simulate.controllers.blocks import (
    AttitudePid,
    PidState,
    anti_windup_rate,
    attitude_torque,
    clip,
    limit_slew_rate,
    next_pid_state,
)
from benchtool.simulate.gain_file import load_gains


def soft(**changes: float) -> AttitudePid:
    attitude = load_gains("s3").attitude
    numbers = {name: getattr(attitude, name) for name in attitude.__slots__}
    return AttitudePid(**numbers, inertia_kgm2=0.018, torque_limit_Nm=1.0)._replace(**changes)


REST = PidState(0.0, 0.0)


def test_the_static_stiffness_of_s3_is_the_published_one():
    """K = J k_theta k_q = 0.386 N m/rad; the set of an autopilot has 1.08."""
    assert attitude_torque(0.001, 0.0, 0.0, REST, soft()) / 0.001 == pytest.approx(0.386, abs=5e-4)
    stiff = load_gains("stiff").attitude
    assert 0.018 * stiff.k_theta_per_s * stiff.k_q_per_s == pytest.approx(1.08)


def test_a_step_of_the_reference_gives_no_kick_beyond_the_rate_limit():
    p = soft()
    assert attitude_torque(10.0, 0.0, 0.0, REST, p) == pytest.approx(0.018 * 7.4 * 3.5)


def test_integrals_stop_while_the_torque_is_at_its_limit_and_come_back_at_once():
    p = soft(k_i_theta_per_s2=1.0, k_i_q_per_s2=2.0, torque_limit_Nm=0.05)
    state = REST
    for _ in range(1000):
        state = next_pid_state(0.5, 0.0, 0.0, state, p, 0.004)
    assert state == REST
    back = next_pid_state(-0.01, 0.0, 0.0, PidState(0.3, 1.0), p, 0.004)
    assert back.rate_rad_s < 0.3


def test_an_integral_removes_what_is_left_over():
    """A double integrator under a constant torque ends at the reference, to 1e-6 rad."""
    p = soft(k_i_theta_per_s2=1.5)
    angle = rate = 0.0
    state, dt_s = REST, 0.002
    for _ in range(20_000):
        torque = attitude_torque(0.1, angle, rate, state, p) - 0.01
        state = next_pid_state(0.1, angle, rate, state, p, dt_s)
        rate += dt_s * torque / 0.018
        angle += dt_s * rate
    assert angle == pytest.approx(0.1, abs=1e-6)


def test_limits():
    np.testing.assert_array_equal(clip(np.array([-3.0, 0.5, 3.0]), 1.0), [-1.0, 0.5, 1.0])
    assert limit_slew_rate(1.0, 0.0, 0.65, 0.004) == pytest.approx(0.0026)
    assert limit_slew_rate(1e-4, 0.0, 0.65, 0.004) == 1e-4
    assert anti_windup_rate(2.0, 1.0, 0.5) == 0.0
    assert anti_windup_rate(2.0, 1.0, -0.5) == -0.5
    assert anti_windup_rate(0.7, 0.7, 0.5) == 0.5
