"""What the virtual ArduPilot and PX4 do with orders: acknowledge, perhaps turn a motor. Pure."""

from __future__ import annotations

from math import isfinite
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.hello import Hello
from benchtool.bench.mavlink_dialect import ESC_STATUS
from benchtool.bench.mavlink_pilots import ACTUATOR_TEST, MOTOR_TEST, MOTORS_OF_FRAME

Array = NDArray[np.float64]

AUTOPILOTS = {"ardupilot": 3, "px4": 12}
"""MAV_AUTOPILOT of what can be imitated, by name."""

DELAY_S = 0.03
"""Between an order and its pulse: 0.02 to 0.07 s on ArduCopter 4.7."""

LONGEST_S = 600.0
PX4_LONGEST_S = 3.0
"""Longest time-outs that are taken (ArduCopter's MOTOR_TEST_TIMEOUT_SEC, PX4's ACTUATOR_TEST)."""

ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4
"""MAV_RESULT."""

CAMERA, SET_SERVO = 206, 183

PLUS_ORDER = (3, 1, 4, 2, 5, 6, 7, 8, 9, 10, 11, 12)
"""Output of each motor, in the order of ArduCopter's motor test on a plus frame."""

STRAIGHT_ORDER = tuple(range(1, 13))

USUAL_RANGE_US = (800.0, 2200.0)
"""Pulses outside of it are acknowledged by ArduPilot and come to nothing."""


class Tests:
    """Know which motors a test turns at present.

    Args:
        n_rotors: how many there are.
        stop_us: pulse of a motor that stands.
        one_at_a_time: a test of another motor ends that of the one before.
        delay_s: between an order and its pulse, wall time.
    """

    def __init__(
        self, n_rotors: int, stop_us: float, one_at_a_time: bool, delay_s: float = DELAY_S
    ) -> None:
        self._delay_s = delay_s
        self._n_rotors, self._stop_us = n_rotors, stop_us
        self._alone = one_at_a_time
        self._coming: list[tuple[float, int, float, float]] = []
        self._running: dict[int, tuple[float, float]] = {}

    @property
    def running(self) -> bool:
        """Whether any motor is in a test."""
        return bool(self._running or self._coming)

    def start(self, motor: int, pulse_us: float, timeout_s: float, now_s: float) -> None:
        """Begin or extend the test of a motor (from 1); it ends by itself."""
        if timeout_s <= 0.0:
            self.end(motor)
        elif motor <= self._n_rotors:
            self._coming.append((now_s + self._delay_s, motor, pulse_us, now_s + timeout_s))

    def end(self, motor: int | None = None) -> None:
        """End the test of a motor, or every test."""
        if motor is None or self._alone:
            self._running, self._coming = {}, []
            return
        self._running.pop(motor, None)
        self._coming = [item for item in self._coming if item[1] != motor]

    def pulses_us(self, now_s: float) -> Array:
        """Return the pulse of every motor (n_rotors,) at a wall time: us."""
        for item in [item for item in self._coming if item[0] <= now_s]:
            _, motor, pulse_us, ends_s = item
            if self._alone:
                self._running = {}
            self._running[motor] = (pulse_us, ends_s)
            self._coming.remove(item)
        self._running = {m: test for m, test in self._running.items() if test[1] > now_s}
        pulses = np.full(self._n_rotors, self._stop_us)
        for motor, (pulse_us, _) in self._running.items():
            pulses[motor - 1] = pulse_us
        return pulses


class Orders(Protocol):
    """Be how one kind of autopilot takes orders.

    Attributes:
        outputs: (n_rotors,) output of each motor, from 1.
        n_outputs: how many outputs are motors', whether or not one hangs there.
        lacks: numbers of the messages that it does not have.
        parameters: by name.
    """

    outputs: tuple[int, ...]
    n_outputs: int
    lacks: frozenset[int]
    parameters: dict[str, float]

    def order(
        self, tests: Tests, command: int, given: tuple[float, ...], now_s: float
    ) -> tuple[int, str]:
        """Take an order; return its result and what is said aloud, or nothing."""
        ...


class ArduPilotOrders:
    """Acknowledge every motor test, whatever it asks; turn a motor for some of them."""

    def __init__(self, hello: Hello) -> None:
        self.outputs = PLUS_ORDER[: hello.n_rotors]
        self.n_outputs = max(4, hello.n_rotors)
        self.lacks = frozenset({251, 339, 290, ESC_STATUS, 375, ACTUATOR_TEST})
        high_us = hello.limits.get("pwm_us", 2000.0)
        span_us = max(high_us - hello.pwm_stop_us, 1.0)
        frames = {motors: frame for frame, motors in reversed(MOTORS_OF_FRAME.items())}
        self.parameters = {
            "FRAME_CLASS": float(frames.get(hello.n_rotors, 1)),
            "MOT_PWM_MIN": hello.pwm_stop_us,
            "MOT_PWM_MAX": high_us,
            "MOT_SPIN_ARM": (hello.pwm_idle_us - hello.pwm_stop_us) / span_us,
        }

    def order(
        self, tests: Tests, command: int, given: tuple[float, ...], now_s: float
    ) -> tuple[int, str]:
        if command == MOTOR_TEST:
            motor, kind, value, timeout_s = given[:4]
            low_us, high_us = USUAL_RANGE_US
            pulse_us = value
            if kind == 0.0:
                least_us = self.parameters["MOT_PWM_MIN"]
                pulse_us = least_us + 0.01 * value * (self.parameters["MOT_PWM_MAX"] - least_us)
            if timeout_s <= 0.0 or (kind in (0.0, 1.0) and low_us <= pulse_us <= high_us):
                tests.start(int(motor), pulse_us, min(timeout_s, LONGEST_S), now_s)
            return ACCEPTED, ""
        if command == SET_SERVO:
            return FAILED, f"ServoRelayEvent: Channel {int(given[0])} is already in use"
        return (ACCEPTED, "") if command == CAMERA else (UNSUPPORTED, "")


class Px4Orders:
    """Turn any number of motors by actuator tests."""

    def __init__(self, hello: Hello) -> None:
        self.outputs = STRAIGHT_ORDER[: hello.n_rotors]
        self.n_outputs = hello.n_rotors
        self.lacks = frozenset({226, 251, 339, 290, 11030, 11031, 11032})
        self.parameters = {
            "CA_ROTOR_COUNT": float(hello.n_rotors),
            "PWM_MAIN_MIN1": hello.pwm_idle_us,
            "PWM_MAIN_MAX1": hello.limits.get("pwm_us", 2000.0),
            "PWM_MAIN_DIS1": hello.pwm_stop_us,
        }

    def order(
        self, tests: Tests, command: int, given: tuple[float, ...], now_s: float
    ) -> tuple[int, str]:
        if command != ACTUATOR_TEST:
            return UNSUPPORTED, ""
        value, timeout_s, motor = given[0], given[1], int(given[4])
        if not 1 <= motor <= 12 or timeout_s > PX4_LONGEST_S:
            return DENIED, ""
        if not isfinite(value):
            tests.end(motor)
            return ACCEPTED, ""
        if not 0.0 <= value <= 1.0:
            return DENIED, ""
        low_us, high_us = self.parameters["PWM_MAIN_MIN1"], self.parameters["PWM_MAIN_MAX1"]
        tests.start(motor, low_us + value * (high_us - low_us), timeout_s, now_s)
        return ACCEPTED, ""


def orders_of(kind: str, hello: Hello) -> Orders:
    """Return how that autopilot takes orders, in front of a bench that says this hello."""
    return Px4Orders(hello) if kind == "px4" else ArduPilotOrders(hello)
