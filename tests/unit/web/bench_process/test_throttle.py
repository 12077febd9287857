"""Dead-man switch and throttle ramp with a given clock."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.core.rig_file import load_rig_by_name
from benchtool.web.bench_process.messages import HoldThrottle, ReleaseThrottle
from benchtool.web.bench_process.throttle import (
    COMMAND_INTERVAL_S,
    RELEASE_TIMEOUT_S,
    DeadManSwitch,
    SLEW_us_s,
    ThrottleRamp,
)

FIRST, SECOND = HoldThrottle("a", 1, 1300.0, (1, 2)), HoldThrottle("a", 2, 1400.0, (1,))


def test_a_hand_that_is_heard_of_holds_on():
    switch = DeadManSwitch()
    assert switch.current_press(0.0) is None
    for beat in range(20):
        switch.hold(FIRST, 0.05 * beat)
        assert switch.current_press(0.05 * beat + 0.04) is FIRST


def test_silence_lets_go_and_a_late_beat_of_that_press_does_not_come_back():
    ended: list[tuple[str, str]] = []
    switch = DeadManSwitch(lambda tab, reason: ended.append((tab, reason)))
    switch.hold(FIRST, 0.0)
    assert switch.current_press(0.99 * RELEASE_TIMEOUT_S) is FIRST
    assert ended == []
    assert switch.current_press(1.5 * RELEASE_TIMEOUT_S) is None
    switch.hold(FIRST, 2.0 * RELEASE_TIMEOUT_S)
    assert switch.current_press(2.0 * RELEASE_TIMEOUT_S) is None
    ((tab, reason),) = ended
    assert tab == "a"
    assert f"for {1500.0 * RELEASE_TIMEOUT_S:.0f} ms" in reason
    assert "no heartbeat from the browser" in reason
    switch.hold(SECOND, 3.0 * RELEASE_TIMEOUT_S)
    assert switch.current_press(3.0 * RELEASE_TIMEOUT_S) is SECOND


def test_a_stop_ends_the_press_that_is_still_held():
    ended: list[tuple[str, str]] = []
    switch = DeadManSwitch(lambda tab, reason: ended.append((tab, reason)))
    switch.hold(FIRST, 0.0)
    switch.end_press("stopped from the page")
    switch.end_press("stopped from the page")
    switch.hold(FIRST, 0.05)
    assert switch.current_press(0.06) is None
    assert ended == [("a", "stopped from the page")]


def test_a_hand_that_lets_go_by_itself_is_not_cut():
    ended: list[tuple[str, str]] = []
    switch = DeadManSwitch(lambda tab, reason: ended.append((tab, reason)))
    switch.hold(FIRST, 0.0)
    switch.release(ReleaseThrottle("a", 1))
    assert switch.current_press(0.01) is None
    assert ended == []


def test_a_beat_is_as_old_as_the_page_says():
    reasons: list[str] = []
    switch = DeadManSwitch(lambda tab, reason: reasons.append(reason), timeout_s=0.5)
    switch.hold(HoldThrottle("a", 1, 1300.0, (1,), age_s=0.4), 10.0)
    assert switch.current_press(10.09) is not None
    assert switch.current_press(10.11) is None
    assert "for 510 ms; allowed: 500 ms: the page is too busy" in reasons[0]


def test_a_press_that_was_let_go_never_turns_a_motor_however_late_its_beats_come():
    switch = DeadManSwitch()
    switch.release(ReleaseThrottle("a", 1))
    switch.hold(FIRST, 0.0)
    assert switch.current_press(0.0) is None
    switch.hold(SECOND, 0.1)
    # The message of the first release arrives again, by the other websocket.
    switch.release(ReleaseThrottle("a", 1))
    assert switch.current_press(0.1) is SECOND
    switch.release(ReleaseThrottle("a", 2))
    switch.release(ReleaseThrottle("a", 1))
    switch.hold(SECOND, 0.2)
    switch.hold(FIRST, 0.2)
    assert switch.current_press(0.2) is None


def test_a_page_that_is_gone_ends_its_own_press_only():
    switch = DeadManSwitch()
    switch.hold(FIRST, 0.0)
    switch.release(ReleaseThrottle("b"))
    assert switch.current_press(0.0) is FIRST
    switch.release(ReleaseThrottle("a"))
    assert switch.current_press(0.0) is None
    switch.hold(FIRST, 0.1)
    assert switch.current_press(0.1) is None


RIG = load_rig_by_name("pquad")
STOP_US = RIG.propulsion.pwm_stop_us


class Motors:
    """Substitute for a guarded bench."""

    def __init__(self) -> None:
        self.pwm_us = np.full(4, STOP_US)
        self.stops = 0

    def set_pwm(self, pwm_us: Any) -> None:
        self.pwm_us = np.array(pwm_us)

    def stop(self) -> None:
        self.stops += 1
        self.pwm_us = np.full(4, STOP_US)


def test_pulses_rise_slowly_and_only_those_of_the_chosen_rotors():
    motors, ramp = Motors(), ThrottleRamp(RIG)
    press = HoldThrottle("a", 1, 1500.0, (1, 3))
    commands = []
    for step in range(200):
        ramp.step(motors, press, 0.02 * step)  # type: ignore[arg-type]
        commands.append(motors.pwm_us.copy())
    rises = np.diff([command[0] for command in commands])
    assert rises.max() <= max(
        SLEW_us_s * 2.0 * COMMAND_INTERVAL_S, RIG.propulsion.pwm_start_us - STOP_US
    )
    assert commands[-1].tolist() == [1500.0, STOP_US, 1500.0, STOP_US]
    assert motors.stops == 0


def test_without_a_hand_motors_are_stopped_at_once_and_once():
    motors, ramp = Motors(), ThrottleRamp(RIG)
    motors.set_pwm([1500.0] * 4)
    for step in range(3):
        ramp.step(motors, None, 0.01 * step)  # type: ignore[arg-type]
    assert motors.stops == 1
    assert (motors.pwm_us == STOP_US).all()


def test_a_lower_pulse_is_taken_at_once_and_unknown_rotors_are_left_out():
    motors, ramp = Motors(), ThrottleRamp(RIG)
    motors.set_pwm([1500.0] * 4)
    ramp.step(motors, HoldThrottle("a", 1, 1200.0, (1, 9)), 1.0)  # type: ignore[arg-type]
    assert motors.pwm_us.tolist() == [1200.0, STOP_US, STOP_US, STOP_US]
