"""Rows of readings from an autopilot's messages, with their times since boot. Pure functions.

A row has the new values of one millisecond. No value is repeated: a channel without a new value is
nan.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from math import asin, nan
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.clocks import DeviceClock
from benchtool.bench.drivers import DOWNWARD_ORIENTATION
from benchtool.bench.mavlink.frames import Message
from benchtool.bench.mavlink.settings import NO_THRUST, MavlinkSettings, MotorMap, build_channels
from benchtool.core.units import Array

UNKNOWN_U16 = 65535  # battery value without a measurement

OUTPUTS = 16
DISTANCES = ("virtual world", "DISTANCE_SENSOR", "RANGEFINDER")  # sources of the plate distance
TELEMETRY = {"ESC_TELEMETRY_1_TO_4": 0, "ESC_TELEMETRY_5_TO_8": 4, "ESC_TELEMETRY_9_TO_12": 8}

_SERVO_OUTPUTS = attrgetter(*(f"servo{number + 1}_raw" for number in range(OUTPUTS)))


def _parse_supply(millivolts: Iterable[int], centiamperes: int) -> dict[str, float]:
    cells = [mV for mV in millivolts if mV not in (0, UNKNOWN_U16)]
    values = {"voltage_V": 1e-3 * sum(cells)} if cells else {}
    return values if centiamperes < 0 else values | {"current_A": 0.01 * centiamperes}


def _parse_target_pitch(message: Message) -> dict[str, float]:
    w, x, y, z = message.q
    return {"theta_ref_rad": -asin(min(1.0, max(-1.0, 2.0 * (w * y - z * x))))}


VALUES: dict[str, Callable[[Message], Mapping[str, float]]] = {  # of messages with values only
    "BATTERY_STATUS": lambda m: _parse_supply((*m.voltages, *m.voltages_ext), m.current_battery),
    "SYS_STATUS": lambda m: _parse_supply((m.voltage_battery,), m.current_battery),
    # MAVLink's pitch is positive nose up.
    "ATTITUDE": lambda m: {"theta_rad": -m.pitch, "gyro_rad_s": -m.pitchspeed},
    "ATTITUDE_TARGET": _parse_target_pitch,
    "SYSTEM_TIME": lambda m: {},
}

SPEEDS: dict[str, Callable[[Message], Iterable[tuple[int, float]]]] = {  # by the ESC, from 1
    "ESC_STATUS": lambda m: [(m.index + i, abs(float(rpm))) for i, rpm in enumerate(m.rpm, 1)],
    "RAW_RPM": lambda m: [(m.index + 1, m.frequency)],
    # -1 means a sensor that is not configured.
    "RPM": lambda m: [(esc, rpm) for esc, rpm in ((1, m.rpm1), (2, m.rpm2)) if rpm >= 0.0],
}


class MavlinkRows:
    """Converter of messages to rows.

    A virtual autopilot reports the exact plate distance.
    """

    def __init__(
        self, wiring: MotorMap, settings: MavlinkSettings, idle_us: float, virtual: bool = False
    ) -> None:
        self.time = BootTime()
        # (16,) last reported pulse width of every output, 0 without pulses, nan if the autopilot
        # sends nan, which is neither a stop nor a command
        self.outputs_us: tuple[float, ...] = (0,) * OUTPUTS
        self.speeds = SpeedSources(wiring.n_rotors)
        self.idle_us = idle_us  # larger outputs drive their motors
        self._wiring, self._settings, self._virtual = wiring, settings, virtual
        self._thrust = NO_THRUST if settings.cell else settings.thrust
        names = [channel.name for channel in build_channels(wiring.n_rotors)]
        self._columns = {name: index for index, name in enumerate(names)}
        self._blank = [nan] * len(names)
        # Unknown outputs are assigned in order; at standstill all have the same value.
        self._rotor_outputs = [output or rotor for rotor, output in enumerate(wiring.outputs, 1)]
        self._rotor_escs = list(wiring.escs)
        # Last reported speed of each ESC, by its number from 1
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

        Rotors with unknown output are assigned ESCs with telemetry, because all read 0 at rest.
        """
        n = self._wiring.n_rotors
        unknown = [rotor for rotor, output in enumerate(self._wiring.outputs) if not output]
        silent = [rotor for rotor in unknown if self._rotor_escs[rotor] not in self.speeds_rpm]
        free_escs = [esc for esc in sorted(self.speeds_rpm) if esc not in self._rotor_escs]
        for rotor, esc in zip(silent, free_escs, strict=False):
            self._rotor_escs[rotor] = esc
        received = {n + i for i in unknown if self._rotor_escs[i] in self.speeds_rpm}
        return np.array(sorted(self._reported | received), np.intp)

    def update(self, message: Message, arrived_us: int | None = None) -> None:
        """Process a message; messages without readings are ignored.

        Args:
            message: of the autopilot, or of a companion of the same system.
            arrived_us: the autopilot's time at the arrival of a companion's message; None for the
                autopilot's messages, whose stamps are its time.
        """
        name, message_time = message.msgname, self.time.message_time_us
        if name == "SERVO_OUTPUT_RAW":
            if arrived_us is None and message.port == 0:
                self._process_outputs(self.time.us32(message.time_usec), _SERVO_OUTPUTS(message))
        elif name == self._thrust.message or (
            name == "DISTANCE_SENSOR" and self._settings.orientation is not None
        ):
            if arrived_us is not None and (stamp_ms := getattr(message, "time_boot_ms", 0)):
                clock = self._companions.setdefault(message.get_srcComponent(), CompanionTime())
                arrived_us = clock.us(stamp_ms, arrived_us)
            self._process_thrust_or_distance(message, arrived_us)
        elif arrived_us is not None:
            return
        elif name in VALUES:
            time_us = message_time(message)
            for channel, value in VALUES[name](message).items():
                self._put(time_us, self._columns[channel], value)
        elif name == "ACTUATOR_OUTPUT_STATUS":
            self._process_outputs(message_time(message), tuple(message.actuator[:OUTPUTS]))
        elif name == "NAMED_VALUE_FLOAT":
            self._process_virtual_plate(message)
        elif name == "RANGEFINDER":
            # Deprecated, without stamp and orientation: ArduPilot sends the downward sensor.
            if message.distance > 0.0 and self._settings.orientation == DOWNWARD_ORIENTATION:
                self._put_distance(message.distance, self.time.last_us, name)
        elif self._settings.speeds and name in TELEMETRY:
            self._process_telemetry(message, TELEMETRY[name])
        elif self._settings.speeds and name in SPEEDS:
            time_us = message_time(message)
            for esc, rpm in SPEEDS[name](message):
                self._process_speed(name, esc, rpm, time_us)

    def assign_output(self, rotor: int, output: int) -> None:
        """Assign an output to a rotor (both from 1), identified while only that rotor turned.

        ESCs have the numbers of their outputs; the rotor that had this number gets the other one.
        """
        for numbers in (self._rotor_outputs, self._rotor_escs):
            if output in numbers:
                numbers[numbers.index(output)] = numbers[rotor - 1]
            numbers[rotor - 1] = output

    def take_rows(self) -> tuple[NDArray[np.int64], Array]:
        """Return device times (m,): us and values (m, c) since the last call, oldest first.

        The newest row is held back, because its millisecond may not be over.
        """
        complete_rows = self._rows[:-1]
        times_us = np.array(self._times_us[:-1], np.int64)
        values = np.array(complete_rows, float).reshape(len(complete_rows), len(self._blank))
        self._rows, self._times_us = self._rows[-1:], self._times_us[-1:]
        return times_us, values

    def _put(self, time_us: int, column: int, value: float) -> None:
        """Write a value into the row of its millisecond; a second value starts another row."""
        self._reported.add(column)
        if self._row and time_us // 1000 <= self._row_us // 1000:
            if self._row[column] != self._row[column]:
                self._row[column] = value
                return
            # Reported twice within a millisecond, or late: the next row after it.
            time_us = self._row_us + 1
        self._row = self._blank.copy()
        self._row_us = max(time_us, self._row_us + 1)
        self._row[column] = value
        self._rows.append(self._row)
        self._times_us.append(self._row_us)

    def _process_outputs(self, time_us: int, pulses: tuple[float, ...]) -> None:
        self.outputs_us = pulses
        for rotor, output in enumerate(self._rotor_outputs):
            # 0 means no pulses: the safety switch is on, or the autopilot is still starting.
            self._put(time_us, rotor, float(pulses[output - 1]))

    def _process_virtual_plate(self, message: Message) -> bool:
        """Process the exact distance of a virtual autopilot; return whether it was one."""
        if not (self._virtual and message.name == "plate_z"):
            return False
        self._put_distance(message.value, self.time.message_time_us(message), "virtual world")
        return True

    def _process_thrust_or_distance(self, message: Message, arrival_us: int | None) -> None:
        """Process a message of autopilot or companion; `arrival_us` is set for a companion's."""
        name, thrust = message.msgname, self._thrust
        if name == "DISTANCE_SENSOR":
            if (
                message.orientation == self._settings.orientation
                and message.min_distance <= message.current_distance <= message.max_distance
            ):
                time_us = self.time.message_time_us(message) if arrival_us is None else arrival_us
                self._put_distance(0.01 * message.current_distance, time_us, name)
            return
        may_be_plate = arrival_us is None and name == "NAMED_VALUE_FLOAT"
        if (may_be_plate and self._process_virtual_plate(message)) or message.name != thrust.name:
            return
        if name == "DEBUG_FLOAT_ARRAY":
            raw = message.data[int(thrust.part)]
        else:
            raw = getattr(message, thrust.part or "value")
        time_us = self.time.message_time_us(message) if arrival_us is None else arrival_us
        self._put(time_us, self._columns["thrust_raw"], raw)
        self._put(time_us, self._columns["thrust_N"], raw * self._settings.thrust_scale_N)

    def _process_speed(self, source: str, esc: int, rpm: float, time_us: int) -> None:
        self.speeds_rpm[esc] = rpm
        if esc not in self._rotor_escs:
            return
        rotor = self._rotor_escs.index(esc)
        is_driven = self.outputs_us[self._rotor_outputs[rotor] - 1] > self.idle_us
        if self.speeds.take(source, rotor, rpm, is_driven, time_us):
            self._put(time_us, self._wiring.n_rotors + rotor, rpm)

    def _process_telemetry(self, message: Message, first_index: int) -> None:
        time_us = self.time.last_us
        temperatures_degC: list[float] = []
        for index in range(4):
            # An ESC whose packet counter is constant has no data; the first count may be old.
            esc, count = first_index + index + 1, message.count[index]
            previous_count = self._counts.setdefault(esc, count)
            if count != previous_count:
                self._counts[esc] = count
                temperatures_degC.append(float(message.temperature[index]))
                self._process_speed("ESC_TELEMETRY", esc, float(message.rpm[index]), time_us)
        if temperatures_degC:
            self._put(time_us, self._columns["temperature_degC"], max(temperatures_degC))

    def _put_distance(self, z_m: float, time_us: int, source: str) -> None:
        """Write the plate's distance from the best source so far."""
        self._best_distance = min(source, self._best_distance or source, key=DISTANCES.index)
        if source == self._best_distance:
            self._put(time_us, self._columns["plate_z_m"], z_m)


SPEED_SOURCES = ("ESC_TELEMETRY", *SPEEDS)  # messages with speeds, the most reliable first
FROZEN_ZERO_US = 1_000_000  # of zeros from a driven motor: an ESC without telemetry; assumed


@dataclass(slots=True)
class _SpeedState:
    selected: str = ""
    zero_since_us: dict[str, int] = field(default_factory=dict)
    valid: set[str] = field(default_factory=set)
    dead: set[str] = field(default_factory=set)


class SpeedSources:
    """Selection of the message with valid speeds; speeds of a dead channel are rejected."""

    def __init__(self, n_rotors: int) -> None:
        self._rotors = [_SpeedState() for _ in range(n_rotors)]
        self._messages: list[str] = []

    def take(self, source: str, rotor: int, rpm: float, is_driven: bool, time_us: int) -> bool:
        """Update a rotor (from 0) with a reading; return whether it is the rotor's speed."""
        state = self._rotors[rotor]
        if rpm != 0.0:
            state.valid.add(source)
            state.dead.discard(source)
        if rpm != 0.0 or not is_driven:
            state.zero_since_us.pop(source, None)
        elif (
            time_us - state.zero_since_us.setdefault(source, time_us) >= FROZEN_ZERO_US
            and source not in state.dead
        ):
            state.dead.add(source)
            if source == state.selected:
                self._messages.append(
                    f"rpm{rotor + 1} of {source} reads 0 while its motor is driven: a dead "
                    f"channel, not a speed; enable the ESC's telemetry or exclude it with "
                    f"rpm=none"
                )
        if not state.selected or (
            state.selected not in state.valid
            and SPEED_SOURCES.index(source) < SPEED_SOURCES.index(state.selected)
        ):
            state.selected = source
        if state.selected in state.dead and source in state.valid - state.dead:
            self._messages.append(f"rpm{rotor + 1} is now taken from {source}")
            state.selected = source
        return source == state.selected and source not in state.dead

    def take_messages(self) -> list[str]:
        messages, self._messages = self._messages, []
        return messages


TIME_MODULUS = 1 << 32
MAX_BACKWARD_US = 2_000_000  # a larger step back is a restart, not reordering; assumed

# A larger step ahead is a restart as well, because through a wrap a step back is one ahead. A link
# that was silent for so long has already ended its run; assumed.
MAX_FORWARD_US = 600_000_000

EPOCH_US = 1 << 50  # larger stamps (35 years) are since 1970, not since boot; MAVLink allows both


class BootTime:
    """Time since boot, unwrapped from all kinds of stamps: microseconds.

    `SERVO_OUTPUT_RAW.time_usec` has 32 bits and wraps after 71.6 minutes, `time_boot_ms` after
    49.7 days. A message without a stamp gets the last one.
    """

    def __init__(self) -> None:
        self.last_us = 0  # newest time
        self.rebooted = False  # the clock has restarted; time then continues from the last stamp
        self._is_anchored = False
        self._offset_us = 0

    def us32(self, stamp: int) -> int:
        return self._unwrap(stamp, TIME_MODULUS, cannot_wrap=False)

    def ms32(self, stamp: int) -> int:
        return self._unwrap(1000 * stamp, 1000 * TIME_MODULUS)

    def us64(self, stamp: int) -> int:
        """Return the time of a 64-bit stamp; one since 1970 is replaced by the newest time."""
        return self.last_us if stamp == 0 or stamp >= EPOCH_US else self._unwrap(stamp, 1 << 64)

    def message_time_us(self, message: Message) -> int:
        """Return the time of a message from its stamp; without one, the newest time."""
        if (boot_ms := getattr(message, "time_boot_ms", None)) is not None:
            return self.ms32(boot_ms)
        if (stamp := getattr(message, "time_usec", None)) is not None:
            return self.us64(stamp)
        return self.last_us

    def _unwrap(self, stamp: int, modulus: int, cannot_wrap: bool = True) -> int:
        if not self._is_anchored and (cannot_wrap or not self.last_us):
            # The first stamp that cannot have wrapped sets the time since boot.
            self._is_anchored = cannot_wrap
            self.last_us = stamp
            return stamp
        step = (stamp + self._offset_us - self.last_us + modulus // 2) % modulus - modulus // 2
        if not -MAX_BACKWARD_US <= step <= MAX_FORWARD_US:
            self.rebooted = True
            # New times follow earlier ones, so that a recording's time never decreases.
            self._offset_us -= step
            step = 0
        self.last_us = max(self.last_us, self.last_us + step)
        return self.last_us if step > 0 else self.last_us + step


class CompanionTime:
    """Stamps of another component in the autopilot's time.

    The component has a separate clock. Its messages arrive no sooner than they were sent, so the
    smallest recent delay is the offset of the two clocks.
    """

    def __init__(self) -> None:
        self._boot, self._clock = BootTime(), DeviceClock()

    def us(self, stamp_ms: int, arrived_us: int) -> int:
        """Return a 32-bit stamp in ms as the autopilot's us, from its arrival time."""
        sent_us = self._boot.ms32(stamp_ms)
        if self._boot.rebooted:
            self._boot, self._clock = BootTime(), DeviceClock()
            sent_us = self._boot.ms32(stamp_ms)
        self._clock.update(sent_us, 1e-6 * arrived_us)
        time_s = self._clock.host_time_s(np.array([sent_us], np.int64))[0]
        return min(round(1e6 * float(time_s)), arrived_us)
