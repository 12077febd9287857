"""Thrust and drag against speed, speed against pulse width and voltage."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchtool.physics.rotor import (
    drag_torque_Nm,
    ground_effect_thrust_N,
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
