"""Rows of readings from an autopilot's messages: one row for each millisecond that brought some.

Pure. Nothing is held or repeated: a channel without a new value is nan.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from math import asin, nan
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.addresses import DOWNWARD_ORIENTATION
from benchtool.bench.mavlink.frames import BootTime, CompanionTime
from benchtool.bench.mavlink.messages import Message
from benchtool.bench.mavlink.settings import ChannelWiring, channels_of
from benchtool.core.array_type import Array

UNKNOWN_U16 = 65535  # what batteries say of a voltage that nobody measures

OUTPUTS = 16
DISTANCES = ("virtual world", "DISTANCE_SENSOR", "RANGEFINDER")  # sources of the plate distance
TELEMETRY = {"ESC_TELEMETRY_1_TO_4": 0, "ESC_TELEMETRY_5_TO_8": 4, "ESC_TELEMETRY_9_TO_12": 8}

_RAW = attrgetter(*(f"servo{number + 1}_raw" for number in range(OUTPUTS)))


def _supply(millivolts: Iterable[int], centiamperes: int) -> dict[str, float]:
    cells = [mV for mV in millivolts if mV not in (0, UNKNOWN_U16)]
    found = {"voltage_V": 1e-3 * sum(cells)} if cells else {}
    return found if centiamperes < 0 else found | {"current_A": 0.01 * centiamperes}


def _target(message: Message) -> dict[str, float]:
    w, x, y, z = message.q
    return {"theta_ref_rad": -asin(min(1.0, max(-1.0, 2.0 * (w * y - z * x))))}


VALUES: dict[str, Callable[[Message], Mapping[str, float]]] = {  # of messages with nothing else
    "BATTERY_STATUS": lambda m: _supply((*m.voltages, *m.voltages_ext), m.current_battery),
    "SYS_STATUS": lambda m: _supply((m.voltage_battery,), m.current_battery),
    # MAVLink's pitch is positive nose up.
    "ATTITUDE": lambda m: {"theta_rad": -m.pitch, "gyro_rad_s": -m.pitchspeed},
    "ATTITUDE_TARGET": _target,
    "SYSTEM_TIME": lambda m: {},
}

SPEEDS: dict[str, Callable[[Message], Iterable[tuple[int, float]]]] = {  # by the ESC, from 1
    "ESC_STATUS": lambda m: [(m.index + at, abs(float(rpm))) for at, rpm in enumerate(m.rpm, 1)],
    "RAW_RPM": lambda m: [(m.index + 1, m.frequency)],
    # -1 stands for a sensor that is not set up.
    "RPM": lambda m: [(esc, rpm) for esc, rpm in ((1, m.rpm1), (2, m.rpm2)) if rpm >= 0.0],
}


class MavlinkRows:
    """Turn messages into rows.

    Attributes:
        outputs_us: (16,) pulse of every output as last reported, 0 where there is none, nan where
            the autopilot says so: no stop, and nothing that was commanded.
        speeds_rpm: speed that each ESC (by its place, from 1) last reported.

    Args:
        idle_us: outputs above it drive their motors.
        with_speeds: False leaves every speed message aside.
    """

    def __init__(self, wiring: ChannelWiring, idle_us: float, with_speeds: bool = True) -> None:
        self.time = BootTime()
        self.outputs_us: tuple[float, ...] = (0,) * OUTPUTS
        self.speeds = SpeedSources(wiring.n_rotors)
        self.idle_us = idle_us
        self._wiring, self._with_speeds = wiring, with_speeds
        names = [channel.name for channel in channels_of(wiring.n_rotors)]
        self._at = {name: index for index, name in enumerate(names)}
        self._blank = [nan] * len(names)
        # Outputs that nobody knows yet count as straight: all of them show the same at standstill.
        self._outputs_of = [output or rotor for rotor, output in enumerate(wiring.outputs, 1)]
        self._escs_of = list(wiring.escs)
        self.speeds_rpm: dict[int, float] = {}
        self._counts: dict[int, int] = {}
        self._best_distance = ""
        self._reported: set[int] = set()
        self._companions: dict[int, CompanionTime] = {}
        self._row: list[float] = []
        self._row_us = -1
        self._rows: list[list[float]] = []
        self._times_us: list[int] = []

    def live_columns(self) -> NDArray[np.intp]:
        """Return the columns that have had a value so far.

        Rotors whose output is not known yet get ESCs that report something: at rest all read 0.
        """
        n = self._wiring.n_rotors
        unknown = [rotor for rotor, output in enumerate(self._wiring.outputs) if not output]
        silent = [rotor for rotor in unknown if self._escs_of[rotor] not in self.speeds_rpm]
        free = [esc for esc in sorted(self.speeds_rpm) if esc not in self._escs_of]
        for rotor, esc in zip(silent, free, strict=False):
            self._escs_of[rotor] = esc
        received = {n + i for i in unknown if self._escs_of[i] in self.speeds_rpm}
        return np.array(sorted(self._reported | received), np.intp)

    def take(self, message: Message, arrived_us: int | None = None) -> None:
        """Note what a message says; those that say nothing about the bench are passed over.

        Args:
            message: of the autopilot, or of a companion of the same system.
            arrived_us: the autopilot's time when a companion's message arrived; None for the
                autopilot's own, whose stamps are its time.
        """
        name, time = message.msgname, self.time.of
        if name == "SERVO_OUTPUT_RAW":
            if arrived_us is None and message.port == 0:
                self._outputs(self.time.us32(message.time_usec), _RAW(message))
        elif name == self._wiring.thrust.message or (
            name == "DISTANCE_SENSOR" and self._wiring.orientation is not None
        ):
            at_us = None if arrived_us is None else self._companion_us(message, arrived_us)
            self._thrust_or_distance(message, at_us)
        elif arrived_us is not None:
            return
        elif name in VALUES:
            time_us = time(message)
            for channel, value in VALUES[name](message).items():
                self._put(time_us, self._at[channel], value)
        elif name == "ACTUATOR_OUTPUT_STATUS":
            self._outputs(time(message), tuple(message.actuator[:OUTPUTS]))
        elif name == "NAMED_VALUE_FLOAT":
            self._virtual_plate(message)
        elif name == "RANGEFINDER":
            # Deprecated; it has no stamp and no orientation: ArduPilot sends the one looking down.
            if message.distance > 0.0 and self._wiring.orientation == DOWNWARD_ORIENTATION:
                self._plate(message.distance, self.time.last_us, name)
        elif self._with_speeds and name in TELEMETRY:
            self._telemetry(message, TELEMETRY[name])
        elif self._with_speeds and name in SPEEDS:
            time_us = time(message)
            for esc, rpm in SPEEDS[name](message):
                self._speed(name, esc, rpm, time_us)

    def wire(self, rotor: int, output: int) -> None:
        """Note which output drives a rotor (both from 1), found out while it turned alone.

        ESCs are numbered as the outputs that they hang on; the rotor that was taken to hang there
        changes places.
        """
        for places in (self._outputs_of, self._escs_of):
            if output in places:
                places[places.index(output)] = places[rotor - 1]
            places[rotor - 1] = output

    def take_rows(self) -> tuple[NDArray[np.int64], Array]:
        """Return device times (m,): us and values (m, c) since the last call, oldest first.

        The newest row waits for the next one, because its millisecond may not be over.
        """
        done = self._rows[:-1]
        times_us = np.array(self._times_us[:-1], np.int64)
        values = np.array(done, float).reshape(len(done), len(self._blank))
        self._rows, self._times_us = self._rows[-1:], self._times_us[-1:]
        return times_us, values

    def _put(self, time_us: int, column: int, value: float) -> None:
        """Write a value into the row of its millisecond; a second one begins a row of its own."""
        self._reported.add(column)
        if self._row and time_us // 1000 <= self._row_us // 1000:
            if self._row[column] != self._row[column]:
                self._row[column] = value
                return
            # Reported twice within a millisecond, or late: next to the row that it belongs to.
            time_us = self._row_us + 1
        self._row = self._blank.copy()
        self._row_us = max(time_us, self._row_us + 1)
        self._row[column] = value
        self._rows.append(self._row)
        self._times_us.append(self._row_us)

    def _outputs(self, time_us: int, pulses: tuple[float, ...]) -> None:
        self.outputs_us = pulses
        for rotor, output in enumerate(self._outputs_of):
            # 0 is no pulse at all: the safety switch is on, or the start is not over.
            self._put(time_us, rotor, float(pulses[output - 1]))

    def _companion_us(self, message: Message, arrived_us: int) -> int:
        clock = self._companions.setdefault(message.get_srcComponent(), CompanionTime())
        stamp_ms = getattr(message, "time_boot_ms", 0)
        return clock.us(stamp_ms, arrived_us) if stamp_ms else arrived_us

    def _virtual_plate(self, message: Message) -> bool:
        """Take the distance that a virtual world knows exactly; return whether it was one."""
        if not (self._wiring.virtual and message.name == "plate_z"):
            return False
        self._plate(message.value, self.time.of(message), "virtual world")
        return True

    def _thrust_or_distance(self, message: Message, at_us: int | None) -> None:
        """Take what a companion may send as well, at its time if it did."""
        name, wanted = message.msgname, self._wiring.thrust
        if name == "DISTANCE_SENSOR":
            if (
                message.orientation == self._wiring.orientation
                and message.min_distance <= message.current_distance <= message.max_distance
            ):
                time_us = self.time.of(message) if at_us is None else at_us
                self._plate(0.01 * message.current_distance, time_us, name)
            return
        own = at_us is None and name == "NAMED_VALUE_FLOAT"
        if (own and self._virtual_plate(message)) or message.name != wanted.name:
            return
        if name == "DEBUG_FLOAT_ARRAY":
            raw = message.data[int(wanted.part)]
        else:
            raw = getattr(message, wanted.part or "value")
        time_us = self.time.of(message) if at_us is None else at_us
        self._put(time_us, self._at["thrust_raw"], raw)
        self._put(time_us, self._at["thrust_N"], raw * self._wiring.thrust_scale_N)

    def _speed(self, source: str, esc: int, rpm: float, time_us: int) -> None:
        self.speeds_rpm[esc] = rpm
        if esc not in self._escs_of:
            return
        rotor = self._escs_of.index(esc)
        driven = self.outputs_us[self._outputs_of[rotor] - 1] > self.idle_us
        if self.speeds.take(source, rotor, rpm, driven, time_us):
            self._put(time_us, self._wiring.n_rotors + rotor, rpm)

    def _telemetry(self, message: Message, first: int) -> None:
        time_us = self.time.last_us
        warmest: list[float] = []
        for place in range(4):
            # An ESC whose packet counter stands still says nothing; the first count may be old.
            esc, count = first + place + 1, message.count[place]
            before = self._counts.setdefault(esc, count)
            if count != before:
                self._counts[esc] = count
                warmest.append(float(message.temperature[place]))
                self._speed("ESC_TELEMETRY", esc, float(message.rpm[place]), time_us)
        if warmest:
            self._put(time_us, self._at["temperature_degC"], max(warmest))

    def _plate(self, z_m: float, time_us: int, source: str) -> None:
        """Write the plate's distance from the best source that has reported one."""
        self._best_distance = min(source, self._best_distance or source, key=DISTANCES.index)
        if source == self._best_distance:
            self._put(time_us, self._at["plate_z_m"], z_m)


SPEED_SOURCES = ("ESC_TELEMETRY", *SPEEDS)  # messages with speeds, the most trusted first
DEAD_US = 1_000_000  # of zeros from a driven motor's channel: an ESC without telemetry; assumed


@dataclass(slots=True)
class _SpeedState:
    chosen: str = ""
    zero_since_us: dict[str, int] = field(default_factory=dict)
    alive: set[str] = field(default_factory=set)
    dead: set[str] = field(default_factory=set)


class SpeedSources:
    """Take speeds from whichever message lives, and withhold those of a dead one."""

    def __init__(self, n_rotors: int) -> None:
        self._rotors = [_SpeedState() for _ in range(n_rotors)]
        self._messages: list[str] = []

    def take(self, source: str, rotor: int, rpm: float, driven: bool, time_us: int) -> bool:
        """Note a reading of a rotor (from 0); return whether it is the speed of that one."""
        state = self._rotors[rotor]
        if rpm != 0.0:
            state.alive.add(source)
            state.dead.discard(source)
        if rpm != 0.0 or not driven:
            state.zero_since_us.pop(source, None)
        elif (
            time_us - state.zero_since_us.setdefault(source, time_us) >= DEAD_US
            and source not in state.dead
        ):
            state.dead.add(source)
            if source == state.chosen:
                self._messages.append(
                    f"rpm{rotor + 1} of {source} reads 0 while its motor is driven: a dead "
                    f"channel, not a speed; switch the ESC's telemetry on or leave it out with "
                    f"rpm=none"
                )
        if not state.chosen or (
            state.chosen not in state.alive
            and SPEED_SOURCES.index(source) < SPEED_SOURCES.index(state.chosen)
        ):
            state.chosen = source
        if state.chosen in state.dead and source in state.alive - state.dead:
            self._messages.append(f"rpm{rotor + 1} is taken from {source} now")
            state.chosen = source
        return source == state.chosen and source not in state.dead

    def take_messages(self) -> list[str]:
        messages, self._messages = self._messages, []
        return messages
