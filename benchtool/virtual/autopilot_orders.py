"""Motor commands of the virtual ArduPilot and PX4: acknowledgement and output pulses."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import inf, isfinite

import numpy as np

from benchtool.bench.mavlink.autopilots import MAX_PULSE_US, MIN_PULSE_US, MOTORS_OF_FRAME
from benchtool.bench.mavlink.frames import ACTUATOR_TEST, ESC_STATUS, MOTOR_TEST
from benchtool.bench.serial.hello import Hello
from benchtool.core.units import Array

AUTOPILOTS = {"ardupilot": 3, "px4": 12}  # MAV_AUTOPILOT by name
MAX_TEST_S = 600.0
PX4_MAX_TEST_S = 3.0  # maximum timeout (ACTUATOR_TEST)
ACCEPTED, DENIED, UNSUPPORTED, FAILED = 0, 2, 3, 4  # MAV_RESULT
CRITICAL, WARNING, INFO = 2, 4, 6  # MAV_SEVERITY
SET_SERVO, TERMINATE, AUX_FUNCTION, SAFETY_SWITCH = 183, 185, 218, 5300
SET_MODE, CAMERA = 176, 206
EMERGENCY_STOP = 31.0  # ArduPilot's DO_AUX_FUNCTION that stops motors
PLUS_ORDER = (3, 1, 4, 2, 5, 6, 7, 8, 9, 10, 11, 12)  # ArduCopter motor test
STRAIGHT_ORDER = tuple(range(1, 13))


class MotorOrders(ABC):
    """Base class of an autopilot's reaction to motor commands."""

    outputs: tuple[int, ...]  # (n_rotors,) from 1
    n_outputs: int
    lacks: frozenset[int]  # ids of messages that it does not have
    parameters: dict[str, float]

    def __init__(self, hello: Hello) -> None:
        self.safe = False  # safety switch: no output has a pulse
        self.texts: list[tuple[int, str]] = []  # severity and text
        self._n_rotors = hello.n_rotors
        self._stopped: Array = np.full(hello.n_rotors, hello.pwm_stop_us)

    @property
    @abstractmethod
    def running(self) -> bool:
        """True while a motor test runs."""

    @abstractmethod
    def order(self, command: int, params: tuple[float, ...], now_s: float) -> int:
        """Execute a command; return its MAV_RESULT."""

    @abstractmethod
    def pulses_us(self, now_s: float) -> Array:
        """Return the pulse of every motor (n_rotors,) at a wall time: us."""

    @abstractmethod
    def end(self) -> None:
        """End every test, for example when the bench stops the motors."""


@dataclass(slots=True)
class _Test:
    motor: int
    kind: float
    value: float
    timeout_s: float
    count: int
    since_s: float


class ArduPilotOrders(MotorOrders):
    """Motor tests as recorded from ArduCopter 4.6.2.

    One test runs at a time, but its outputs keep their values until it ends: a command for another
    motor leaves the first one turning. Neither disarming nor a failsafe ends it, a timeout below 0
    never does, and pulses outside MOT_PWM_MIN to MOT_PWM_MAX reach the output.
    """

    def __init__(self, hello: Hello) -> None:
        super().__init__(hello)
        self.outputs = PLUS_ORDER[: hello.n_rotors]
        self.n_outputs = max(4, hello.n_rotors)
        self.lacks = frozenset({251, 339, 290, ESC_STATUS, 375, ACTUATOR_TEST})
        self._emergency = False
        self._test: _Test | None = None
        self._pulses = self._stopped
        high_us = hello.limits.get("pwm_us", 2000.0)
        span_us = max(high_us - hello.pwm_stop_us, 1.0)
        frames = {motors: frame for frame, motors in reversed(MOTORS_OF_FRAME.items())}
        self.parameters = {
            "FRAME_CLASS": float(frames.get(hello.n_rotors, 1)),
            "MOT_PWM_MIN": hello.pwm_stop_us,
            "MOT_PWM_MAX": high_us,
            "MOT_SPIN_ARM": (hello.pwm_idle_us - hello.pwm_stop_us) / span_us,
        }

    @property
    def running(self) -> bool:
        return self._test is not None

    def order(self, command: int, params: tuple[float, ...], now_s: float) -> int:
        if command == MOTOR_TEST:
            return self._start(params, now_s)
        if command == SAFETY_SWITCH:
            self.safe = params[0] == 0.0
            return ACCEPTED
        if command == AUX_FUNCTION and params[0] == EMERGENCY_STOP:
            self._emergency = params[1] == 2.0
            return ACCEPTED
        if command == SET_SERVO:
            text = f"ServoRelayEvent: Channel {int(params[0])} is already in use"
            self.texts.append((INFO, text))
            return FAILED
        # Accepted, but they do not end a motor test.
        return ACCEPTED if command in (CAMERA, TERMINATE, SET_MODE) else UNSUPPORTED

    def _start(self, params: tuple[float, ...], now_s: float) -> int:
        motor, kind, value, timeout_s, count = params[:5]
        if self._test is None:
            reason = "Safety switch" if self.safe else "Motor Emergency Stopped"
            if self.safe or self._emergency:
                self.texts.append((CRITICAL, f"Motor Test: {reason}"))
                return FAILED
            self.texts.append((INFO, "starting motor test"))
        duration_s = inf if timeout_s < 0.0 else min(timeout_s, MAX_TEST_S)
        self._test = _Test(int(motor), kind, value, duration_s, max(int(count), 1), now_s)
        if duration_s == 0.0 or self._pulse_us(self._test) is None:
            self.end()
        return ACCEPTED

    def pulses_us(self, now_s: float) -> Array:
        test = self._test
        if test is None:
            return self._pulses
        since_s = now_s - test.since_s
        if since_s < test.timeout_s:
            pulse_us = self._pulse_us(test)
            if pulse_us is not None and 1 <= test.motor <= self._n_rotors:
                self._pulses = self._pulses.copy()
                self._pulses[test.motor - 1] = pulse_us
        elif test.count <= 1:
            self.end()
        else:
            # The next motor, after a pause of half the timeout.
            self._pulses = self._stopped
            if since_s >= 1.5 * test.timeout_s:
                test.motor, test.count, test.since_s = test.motor + 1, test.count - 1, now_s
        return self._pulses

    def end(self) -> None:
        if self._test is not None:
            self.texts.append((INFO, "finished motor test"))
        self._test = None
        self._pulses = self._stopped

    def _pulse_us(self, test: _Test) -> float | None:
        """Return the pulse of a test, None if its value is invalid."""
        min_us, max_us = self.parameters["MOT_PWM_MIN"], self.parameters["MOT_PWM_MAX"]
        if test.kind == 0.0:
            pulse_us = min_us + 0.01 * test.value * (max_us - min_us)
            return float(round(pulse_us)) if 0.0 <= test.value <= 100.0 else None
        if test.kind == 2.0:
            return min_us  # the pilot's throttle, at minimum
        whole_us = float(int(test.value)) if isfinite(test.value) else 0.0
        return whole_us if test.kind == 1.0 and MIN_PULSE_US <= whole_us <= MAX_PULSE_US else None


class Px4Orders(MotorOrders):
    """Actuator tests as in PX4; several motors may run at once."""

    def __init__(self, hello: Hello) -> None:
        super().__init__(hello)
        self.outputs = STRAIGHT_ORDER[: hello.n_rotors]
        self.n_outputs = hello.n_rotors
        self.lacks = frozenset({226, 251, 339, 290, 11030, 11031, 11032})
        self._running: dict[int, tuple[float, float]] = {}
        self.parameters = {
            "CA_ROTOR_COUNT": float(hello.n_rotors),
            "PWM_MAIN_MIN1": hello.pwm_idle_us,
            "PWM_MAIN_MAX1": hello.limits.get("pwm_us", 2000.0),
            "PWM_MAIN_DIS1": hello.pwm_stop_us,
        }

    @property
    def running(self) -> bool:
        return bool(self._running)

    def order(self, command: int, params: tuple[float, ...], now_s: float) -> int:
        if command != ACTUATOR_TEST:
            return UNSUPPORTED
        value, timeout_s, motor = params[0], params[1], int(params[4])
        if not 1 <= motor <= 12 or timeout_s > PX4_MAX_TEST_S:
            return DENIED
        if not isfinite(value):
            self._running.pop(motor, None)
            return ACCEPTED
        if not 0.0 <= value <= 1.0:
            return DENIED
        low_us, high_us = self.parameters["PWM_MAIN_MIN1"], self.parameters["PWM_MAIN_MAX1"]
        if timeout_s > 0.0 and motor <= self._n_rotors:
            self._running[motor] = (low_us + value * (high_us - low_us), now_s + timeout_s)
        return ACCEPTED

    def pulses_us(self, now_s: float) -> Array:
        self._running = {m: test for m, test in self._running.items() if test[1] > now_s}
        pulses = self._stopped.copy()
        for motor, (pulse_us, _) in self._running.items():
            pulses[motor - 1] = pulse_us
        return pulses

    def end(self) -> None:
        self._running = {}
