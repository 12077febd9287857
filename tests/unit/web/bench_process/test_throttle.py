from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.core.rig_file import rig_named
from benchtool.web.bench_process.messages import HoldThrottle
from benchtool.web.bench_process.throttle import STEP_S, SLEW_us_s, ThrottleRamp

RIG = rig_named("pquad")
STOP_US = RIG.propulsion.pwm_stop_us


class Motors:
    """Take pulses as a guarded bench does."""

    def __init__(self) -> None:
        self.pwm_us = np.full(4, STOP_US)
        self.stops = 0

    def set_pwm(self, pwm_us: Any) -> None:
        self.pwm_us = np.array(pwm_us)

    def stop(self) -> None:
        self.stops += 1
        self.pwm_us = np.full(4, STOP_US)


def test_pulses_rise_slowly_and_only_those_of_the_chosen_rotors() -> None:
    motors, throttle = Motors(), ThrottleRamp(RIG)
    wanted = HoldThrottle("a", 1, 1500.0, (1, 3))
    seen = []
    for step in range(200):
        throttle.follow(motors, wanted, 0.02 * step)  # type: ignore[arg-type]
        seen.append(motors.pwm_us.copy())
    rises = np.diff([pulses[0] for pulses in seen])
    assert rises.max() <= max(SLEW_us_s * 2.0 * STEP_S, RIG.propulsion.pwm_start_us - STOP_US)
    assert seen[-1].tolist() == [1500.0, STOP_US, 1500.0, STOP_US]
    assert motors.stops == 0


def test_without_a_hand_motors_are_stopped_at_once_and_once() -> None:
    motors, throttle = Motors(), ThrottleRamp(RIG)
    motors.set_pwm([1500.0] * 4)
    for step in range(3):
        throttle.follow(motors, None, 0.01 * step)  # type: ignore[arg-type]
    assert motors.stops == 1
    assert (motors.pwm_us == STOP_US).all()


def test_a_lower_pulse_is_taken_at_once_and_unknown_rotors_are_left_out() -> None:
    motors, throttle = Motors(), ThrottleRamp(RIG)
    motors.set_pwm([1500.0] * 4)
    throttle.follow(motors, HoldThrottle("a", 1, 1200.0, (1, 9)), 1.0)  # type: ignore[arg-type]
    assert motors.pwm_us.tolist() == [1200.0, STOP_US, STOP_US, STOP_US]
