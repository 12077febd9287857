"""Position loop and feedforward: limits, slews, inverses."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.simulate.controllers.blocks import compensated_thrust, expected_factor
from benchtool.simulate.controllers.laws import (
    HorizontalState,
    PositionLoop,
    climb_command,
    horizontal_step,
    lifting_thrust,
    pitch_command,
    velocity_command,
)
from benchtool.simulate.gain_file import load_gains

POSITION = load_gains("s3").position
LOOP = PositionLoop(*(getattr(POSITION, name) for name in PositionLoop._fields))


def test_far_away_the_velocity_command_slews_up_to_its_limit():
    speed = 0.0
    for _ in range(400):
        speed = velocity_command(7.0, speed, 0.2, LOOP, 0.004)
    assert speed == pytest.approx(0.2)
    assert velocity_command(7.0, 0.0, 0.2, LOOP, 0.004) == pytest.approx(0.65 * 0.004)


def test_the_velocity_integral_is_limited():
    axis, acceleration = HorizontalState(), 0.0
    for _ in range(10_000):
        axis, acceleration = horizontal_step(7.0, 0.2, 0.0, axis, LOOP, 0.004)
    assert axis.integral_m_s2 == pytest.approx(0.58)
    assert acceleration == pytest.approx(1.5 * 0.2 + 0.58)


def test_the_pitch_command_is_limited_to_16_and_a_half_degrees():
    assert np.degrees(pitch_command(100.0, 9.81, LOOP)) == pytest.approx(16.5)
    assert pitch_command(0.981, 9.81, LOOP) == pytest.approx(0.1)


def test_climb_and_thrust():
    assert climb_command(0.1, 0.0, 0.0, 4.0, 3.2, 4.0) == pytest.approx(0.4)
    assert climb_command(10.0, 0.0, 0.0, 4.0, 3.2, 4.0) == 4.0
    level = lifting_thrust(0.0, 1.4, 9.81, 1.0)
    assert level == pytest.approx(1.4 * 9.81)
    assert lifting_thrust(0.0, 1.4, 9.81, np.cos(0.2)) * np.cos(0.2) == pytest.approx(level)


def test_feedforward_gives_back_what_was_wanted():
    factor = 1.0159
    asked = compensated_thrust(3.43, expected_factor(factor, 1.0))
    assert asked * factor == pytest.approx(3.43)
    assert compensated_thrust(3.43, expected_factor(factor, 0.0)) == 3.43
    assert compensated_thrust(-1.0, 1.1) == 0.0
