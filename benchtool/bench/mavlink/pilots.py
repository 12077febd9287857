"""How each autopilot is commanded to turn motors, and what it allows. Pure: commands as numbers.

A pilot is chosen by the heartbeat. Every command dies by itself after `TIMEOUT_S`, so that motors
stand still soon after the host has died; it is sent again every `RESEND_S`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from math import nan

from benchtool.bench.mavlink.messages import dialect
from benchtool.core.errors import (
    InputError,
    ProtocolError,
)

ACCEPTED, IN_PROGRESS = 0, 5

"""MAV_RESULT of an order that is carried out."""


def result_name(result: int | None) -> str:
    """Return a MAV_RESULT in MAVLink's own word."""
    known = dialect().enums["MAV_RESULT"]
    return str(known[result].name).removeprefix("MAV_RESULT_") if result in known else str(result)


def order_text(order: MavCommand) -> str:
    """Return an order as people write it."""
    return f"{_command_name(order.command)} {','.join(f'{value:g}' for value in order.parameters)}"


def _command_name(command: int) -> str:
    known = dialect().enums["MAV_CMD"]
    return str(known[command].name).removeprefix("MAV_CMD_") if command in known else str(command)


TIMEOUT_S = 0.25
"""An order to turn ends by itself after so long: the watchdog of every bench."""

RESEND_S = 0.05
"""How often a standing order is sent again: four in a row may get lost without a gap."""

ARM_DISARM = 400

MOTOR_TEST = 209
"""MAV_CMD_DO_MOTOR_TEST. 206, which some lists give, is a camera command that moves nothing."""

ACTUATOR_TEST = 310

FORCE_DISARM = 21196.0
"""Second parameter of ARM_DISARM that disarms whatever the vehicle does (MAVLink common.xml)."""

LEAST_US, LONGEST_US = 800.0, 2200.0
"""Pulses that ArduCopter's motor test takes at all (RC_MIN_LIMIT_PWM and RC_MAX_LIMIT_PWM)."""

MOTORS_OF_FRAME = {1: 4, 2: 6, 3: 8, 4: 8, 5: 6, 7: 3, 12: 12, 14: 10}
"""ArduCopter's FRAME_CLASS: quad, hexa, octa, octaquad, Y6, tri, dodecahexa, deca."""

TIMEOUT_AT = {MOTOR_TEST: 3, ACTUATOR_TEST: 1}
"""Which parameter of an order to turn is its time-out."""


@dataclass(frozen=True, slots=True)
class MavCommand:
    """One COMMAND_LONG: its number and seven parameters.

    An order to turn lasts from 0 to `TIMEOUT_S`; no other can be made. ArduPilot takes a negative
    time-out for one that never ends, and one that is no number ends its program.

    Raises:
        InputError: a time-out outside of that.
    """

    command: int
    parameters: tuple[float, ...]

    def __post_init__(self) -> None:
        place = TIMEOUT_AT.get(self.command)
        if place is not None and not 0.0 <= self.parameters[place] <= TIMEOUT_S:
            raise InputError(
                f"an order to turn a motor for {self.parameters[place]:g} s was not made, limits 0 "
                f"and {TIMEOUT_S:g} s"
            )


@dataclass(frozen=True, slots=True)
class PulseRange:
    """The pulses of an autopilot's outputs: stopped, slowest, longest, and what counts as idle."""

    stop_us: float
    low_us: float
    high_us: float
    idle_us: float


class Pilot(ABC):
    """Be one kind of autopilot.

    Attributes:
        name: as people call it.
        asked: parameters worth reading when the link opens.
        required: those without which pulses cannot be bounded to the autopilot's own range.
        together: whether several motors can turn in tests at the same time.
        arms: whether its heartbeat shows armed while a motor test runs.
    """

    name: str
    asked: tuple[str, ...]
    required: tuple[str, ...] = ()
    together: bool
    arms: bool

    @abstractmethod
    def n_motors(self, parameters: Mapping[str, float]) -> int | None:
        """Return how many motors its parameters say that it has, None when they do not."""

    @abstractmethod
    def pulses(self, parameters: Mapping[str, float]) -> PulseRange:
        """Return the pulses that its parameters give.

        Raises:
            ProtocolError: the autopilot's range makes no sense.
        """

    @abstractmethod
    def turn(self, pulses_us: Mapping[int, float], pulses: PulseRange) -> tuple[MavCommand, ...]:
        """Return the orders that turn motors (by test number) at pulses above stop.

        Raises:
            InputError: it cannot turn these together, or a pulse lies outside of the range.
        """

    @abstractmethod
    def stop(self, motors: tuple[int, ...]) -> tuple[MavCommand, ...]:
        """Return the orders that stop motors at once."""


class ArduPilot(Pilot):
    """Turn motors by DO_MOTOR_TEST, one at a time."""

    name = "ArduPilot"
    required = ("MOT_PWM_MIN", "MOT_PWM_MAX")
    asked = ("FRAME_CLASS", *required, "MOT_SPIN_ARM")
    arms = True
    together = False

    def n_motors(self, parameters: Mapping[str, float]) -> int | None:
        return MOTORS_OF_FRAME.get(round(parameters.get("FRAME_CLASS", 0.0)))

    def pulses(self, parameters: Mapping[str, float]) -> PulseRange:
        low_us, high_us = parameters["MOT_PWM_MIN"], parameters["MOT_PWM_MAX"]
        if not LEAST_US <= low_us < high_us <= LONGEST_US:
            raise ProtocolError(
                f"MOT_PWM_MIN is {low_us:g} us and MOT_PWM_MAX {high_us:g} us, but benchtool needs "
                f"{LEAST_US:g} to {LONGEST_US:g} us, the less first; set them on the autopilot"
            )
        idle_us = low_us + parameters.get("MOT_SPIN_ARM", 0.1) * (high_us - low_us)
        return PulseRange(low_us, low_us, high_us, idle_us)

    def turn(self, pulses_us: Mapping[int, float], pulses: PulseRange) -> tuple[MavCommand, ...]:
        if len(pulses_us) > 1:
            listed = ", ".join(map(str, sorted(pulses_us)))
            raise InputError(
                f"motors {listed} cannot turn together: ArduPilot's motor test turns one motor at "
                f"a time; name one with --rotors, or use an autopilot whose actuator test allows "
                f"several (PX4)"
            )
        # ArduPilot gives pulses outside of its own range to the output as they are.
        for motor, pulse_us in pulses_us.items():
            if not pulses.low_us <= pulse_us <= pulses.high_us:
                raise InputError(
                    f"a pulse of {pulse_us:g} us for motor {motor} was not sent; the autopilot's "
                    f"range is {pulses.low_us:g} to {pulses.high_us:g} us (MOT_PWM_MIN to "
                    f"MOT_PWM_MAX)"
                )
        # Type 1 is a pulse in us; one motor, the board's usual order.
        return tuple(
            MavCommand(MOTOR_TEST, (motor, 1.0, pulse_us, TIMEOUT_S, 1.0, 0.0, 0.0))
            for motor, pulse_us in pulses_us.items()
        )

    def stop(self, motors: tuple[int, ...]) -> tuple[MavCommand, ...]:
        # A time-out of 0 ends the test, whichever motor turns.
        return (MavCommand(MOTOR_TEST, (motors[0], 1.0, 0.0, 0.0, 1.0, 0.0, 0.0)),)


class Px4(Pilot):
    """Turn motors by ACTUATOR_TEST, any number together."""

    name = "PX4"
    asked = ("CA_ROTOR_COUNT", "PWM_MAIN_MIN1", "PWM_MAIN_MAX1", "PWM_MAIN_DIS1")
    arms = False
    together = True

    def n_motors(self, parameters: Mapping[str, float]) -> int | None:
        return round(parameters.get("CA_ROTOR_COUNT", 0.0)) or None

    def pulses(self, parameters: Mapping[str, float]) -> PulseRange:
        low_us, high_us = (
            parameters.get("PWM_MAIN_MIN1", 1100.0),
            parameters.get("PWM_MAIN_MAX1", 1900.0),
        )
        stop_us = parameters.get("PWM_MAIN_DIS1", 1000.0)
        return PulseRange(stop_us, low_us, high_us, low_us)

    def turn(self, pulses_us: Mapping[int, float], pulses: PulseRange) -> tuple[MavCommand, ...]:
        span_us = pulses.high_us - pulses.low_us
        orders = []
        for motor, pulse_us in pulses_us.items():
            # From 0 (slowest) to 1; below the slowest pulse a motor is stopped.
            value = (pulse_us - pulses.low_us) / span_us if pulse_us >= pulses.low_us else nan
            orders.append(self._test(motor, value, TIMEOUT_S))
        return tuple(orders)

    def stop(self, motors: tuple[int, ...]) -> tuple[MavCommand, ...]:
        return tuple(self._test(motor, nan, 0.0) for motor in motors)

    def _test(self, motor: int, value: float, timeout_s: float) -> MavCommand:
        # The fifth parameter is the output function: 1 to 12 are motors.
        return MavCommand(ACTUATOR_TEST, (value, timeout_s, 0.0, 0.0, float(motor), 0.0, 0.0))


PILOTS: dict[int, Pilot] = {3: ArduPilot(), 12: Px4()}
"""By the heartbeat's MAV_AUTOPILOT."""

AUTOPILOT_INVALID = 8
"""MAV_AUTOPILOT of what is no autopilot: ground stations, gimbals, companions."""


SEEN_S = 0.3

"""An acknowledged pulse must show at the outputs within this; ArduPilot takes 0.02 to 0.07 s."""
