"""Rows of readings from an autopilot's messages: one row for each millisecond that brought some.

Pure. Nothing is held or repeated: a channel without a new value is nan.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from math import asin, nan
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.mavlink.frames import BootTime, CompanionTime
from benchtool.bench.mavlink.messages import Message
from benchtool.bench.mavlink.settings import DOWN, Wiring, channels_of
from benchtool.core.array import Array

UNKNOWN_U16 = 65535
"""What batteries say of a voltage that nobody measures."""

OUTPUTS = 16

DISTANCES = ("virtual world", "DISTANCE_SENSOR", "RANGEFINDER")
"""What reports the plate's distance, the best first."""

_RAW = attrgetter(*(f"servo{number + 1}_raw" for number in range(OUTPUTS)))


class MavlinkRows:
    """Turn messages into rows.

    Attributes:
        time: the autopilot's clock.
        outputs_us: (16,) pulse of every output as last reported, 0 where there is none.
        speeds_rpm: speed that each ESC (by its place, from 1) last reported.
        speeds: which speed message lives.

    Args:
        wiring: which message feeds which channel.
        idle_us: outputs above it drive their motors.
        with_speeds: False leaves every speed message aside.
    """

    def __init__(self, wiring: Wiring, idle_us: float, with_speeds: bool = True) -> None:
        self.time = BootTime()
        self.outputs_us: tuple[int, ...] = (0,) * OUTPUTS
        self.speeds = SpeedSources(wiring.n_rotors)
        self.idle_us = idle_us
        self._wiring = wiring
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
        self._take: dict[str, Callable[[Message], None]] = {
            "SERVO_OUTPUT_RAW": self._servo,
            "ACTUATOR_OUTPUT_STATUS": self._actuators,
            "BATTERY_STATUS": self._battery,
            "SYS_STATUS": self._power,
            "ATTITUDE": self._attitude,
            "ATTITUDE_TARGET": self._target,
            "SYSTEM_TIME": self._clock,
            wiring.thrust.message: self._thrust,
            "NAMED_VALUE_FLOAT": self._named,
        }
        self._take_from_others: dict[str, Callable[[Message, int], None]] = {
            wiring.thrust.message: self._thrust
        }
        if wiring.orientation is not None:
            self._take |= {"DISTANCE_SENSOR": self._distance, "RANGEFINDER": self._rangefinder}
            self._take_from_others["DISTANCE_SENSOR"] = self._distance
        if with_speeds:
            self._take |= {
                "ESC_TELEMETRY_1_TO_4": lambda message: self._telemetry(message, 0),
                "ESC_TELEMETRY_5_TO_8": lambda message: self._telemetry(message, 4),
                "ESC_TELEMETRY_9_TO_12": lambda message: self._telemetry(message, 8),
                "ESC_STATUS": self._esc_status,
                "RAW_RPM": self._raw_rpm,
                "RPM": self._rpm,
            }

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
        if arrived_us is None:
            if (take := self._take.get(message.msgname)) is not None:
                take(message)
        elif (other := self._take_from_others.get(message.msgname)) is not None:
            source = message.get_srcComponent()
            clock = self._companions.setdefault(source, CompanionTime())
            stamp_ms = getattr(message, "time_boot_ms", 0)
            other(message, clock.us(stamp_ms, arrived_us) if stamp_ms else arrived_us)

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
        if self._row and time_us // 1000 <= self._row_us // 1000:
            if self._row[column] != self._row[column]:
                self._row[column] = value
                self._reported.add(column)
                return
            # Reported twice within a millisecond, or late: next to the row that it belongs to.
            time_us = self._row_us + 1
        self._row = self._blank.copy()
        self._row_us = max(time_us, self._row_us + 1)
        self._row[column] = value
        self._reported.add(column)
        self._rows.append(self._row)
        self._times_us.append(self._row_us)

    def _servo(self, message: Message) -> None:
        if message.port != 0:
            return
        self._outputs(self.time.us32(message.time_usec), _RAW(message))

    def _actuators(self, message: Message) -> None:
        pulses = tuple(round(value) for value in message.actuator[:OUTPUTS])
        self._outputs(self.time.us64(message.time_usec), pulses)

    def _outputs(self, time_us: int, pulses: tuple[int, ...]) -> None:
        self.outputs_us = pulses
        for rotor, output in enumerate(self._outputs_of):
            # 0 is no pulse at all: the safety switch is on, or the start is not over.
            self._put(time_us, rotor, float(pulses[output - 1]))

    def _named(self, message: Message) -> None:
        """Take a value under a name: thrust, or the distance that a virtual world knows exactly."""
        if self._wiring.virtual and message.name == "plate_z":
            self._plate(message.value, self.time.ms32(message.time_boot_ms), "virtual world")
        elif self._wiring.thrust.message == "NAMED_VALUE_FLOAT":
            self._thrust(message)

    def _thrust(self, message: Message, at_us: int | None = None) -> None:
        wanted = self._wiring.thrust
        if message.name != wanted.name:
            return
        if wanted.message == "NAMED_VALUE_FLOAT":
            time_us = self.time.ms32(message.time_boot_ms) if at_us is None else at_us
            raw = message.value
        else:
            time_us = self.time.us64(message.time_usec) if at_us is None else at_us
            in_array = wanted.message == "DEBUG_FLOAT_ARRAY"
            raw = message.data[int(wanted.part)] if in_array else getattr(message, wanted.part)
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

    def _esc_status(self, message: Message) -> None:
        time_us = self.time.us64(message.time_usec)
        for place, rpm in enumerate(message.rpm):
            self._speed("ESC_STATUS", message.index + place + 1, abs(float(rpm)), time_us)

    def _raw_rpm(self, message: Message) -> None:
        self._speed("RAW_RPM", message.index + 1, message.frequency, self.time.last_us)

    def _rpm(self, message: Message) -> None:
        for esc, rpm in ((1, message.rpm1), (2, message.rpm2)):
            # -1 stands for a sensor that is not set up.
            if rpm >= 0.0:
                self._speed("RPM", esc, rpm, self.time.last_us)

    def _distance(self, message: Message, at_us: int | None = None) -> None:
        if message.orientation != self._wiring.orientation:
            return
        if message.min_distance <= message.current_distance <= message.max_distance:
            time_us = self.time.ms32(message.time_boot_ms) if at_us is None else at_us
            self._plate(0.01 * message.current_distance, time_us, "DISTANCE_SENSOR")

    def _rangefinder(self, message: Message) -> None:
        # Deprecated; it has no stamp and no orientation: ArduPilot sends the one that looks down.
        if message.distance > 0.0 and self._wiring.orientation == DOWN:
            self._plate(message.distance, self.time.last_us, "RANGEFINDER")

    def _plate(self, z_m: float, time_us: int, source: str) -> None:
        """Write the plate's distance from the best source that has reported one."""
        self._best_distance = min(source, self._best_distance or source, key=DISTANCES.index)
        if source == self._best_distance:
            self._put(time_us, self._at["plate_z_m"], z_m)

    def _battery(self, message: Message) -> None:
        cells = [
            mV for mV in (*message.voltages, *message.voltages_ext) if mV not in (0, UNKNOWN_U16)
        ]
        self._supply(1e-3 * sum(cells) if cells else nan, message.current_battery)

    def _power(self, message: Message) -> None:
        known = message.voltage_battery not in (0, UNKNOWN_U16)
        volts = 1e-3 * message.voltage_battery if known else nan
        self._supply(volts, message.current_battery)

    def _supply(self, volts: float, centiamperes: int) -> None:
        if volts == volts:
            self._put(self.time.last_us, self._at["voltage_V"], volts)
        if centiamperes >= 0:
            self._put(self.time.last_us, self._at["current_A"], 0.01 * centiamperes)

    def _attitude(self, message: Message) -> None:
        time_us = self.time.ms32(message.time_boot_ms)
        # MAVLink's pitch is positive nose up.
        self._put(time_us, self._at["theta_rad"], -message.pitch)
        self._put(time_us, self._at["gyro_rad_s"], -message.pitchspeed)

    def _target(self, message: Message) -> None:
        w, x, y, z = message.q
        sine = min(1.0, max(-1.0, 2.0 * (w * y - z * x)))
        time_us = self.time.ms32(message.time_boot_ms)
        self._put(time_us, self._at["theta_ref_rad"], -asin(sine))

    def _clock(self, message: Message) -> None:
        self.time.ms32(message.time_boot_ms)


SPEED_SOURCES = ("ESC_TELEMETRY", "ESC_STATUS", "RAW_RPM", "RPM")
"""Messages that carry speeds, the most trusted first: ESCs name the motor they turn."""

DEAD_US = 1_000_000
"""A channel that reads 0 for so long while its motor is driven is dead: an ESC without telemetry
reads 0 for ever. A choice, above the time in which small rotors start."""


@dataclass(slots=True)
class _SpeedState:
    chosen: str = ""
    zero_since_us: dict[str, int] = field(default_factory=dict)
    lively: set[str] = field(default_factory=set)
    dead: set[str] = field(default_factory=set)


class SpeedSources:
    """Take speeds from whichever message lives, and withhold those of a dead one."""

    def __init__(self, n_rotors: int) -> None:
        self._rotors = [_SpeedState() for _ in range(n_rotors)]
        self._messages: list[str] = []

    def take(self, source: str, rotor: int, rpm: float, driven: bool, time_us: int) -> bool:
        """Note a reading; return whether it is the speed of that rotor (from 0).

        Args:
            source: one of `SPEED_SOURCES`.
            rotor: number from 0.
            rpm: reading.
            driven: whether the rotor's output is above idle.
            time_us: of the reading, on the autopilot's clock.
        """
        state = self._rotors[rotor]
        if rpm != 0.0:
            state.lively.add(source)
            state.dead.discard(source)
            state.zero_since_us.pop(source, None)
        elif not driven:
            state.zero_since_us.pop(source, None)
        elif time_us - state.zero_since_us.setdefault(source, time_us) >= DEAD_US:
            self._bury(rotor, source)
        if not state.chosen or (
            state.chosen not in state.lively
            and SPEED_SOURCES.index(source) < SPEED_SOURCES.index(state.chosen)
        ):
            state.chosen = source
        if state.chosen in state.dead and source in state.lively - state.dead:
            self._messages.append(f"rpm{rotor + 1} is taken from {source} now")
            state.chosen = source
        return source == state.chosen and source not in state.dead

    def take_messages(self) -> list[str]:
        """Return what was found out since the last call, in words."""
        messages, self._messages = self._messages, []
        return messages

    def _bury(self, rotor: int, source: str) -> None:
        state = self._rotors[rotor]
        if source in state.dead:
            return
        state.dead.add(source)
        if source == state.chosen:
            self._messages.append(
                f"rpm{rotor + 1} of {source} reads 0 while its motor is driven: a dead channel, "
                f"not a speed; switch the ESC's telemetry on or leave it out with rpm=none"
            )
