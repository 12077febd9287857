"""Device firmware without link or clock: limits on every tick, latch, watchdog.

Device time counts ticks and is scaled by the speed; only the watchdog uses wall time (`now_s`).
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.serial import commands as wire
from benchtool.bench.serial.hello import Hello
from benchtool.core.channel import Channel
from benchtool.core.errors import BenchtoolError
from benchtool.core.units import Array

MAX_RATE_HZ = 5000.0  # fastest stream of a small microcontroller; assumed
MAX_REASON_LENGTH = 300  # maximum length of a failure's reason, so that it fits one line
REPEAT_INTERVAL_S = 1.0  # interval at which a stopped device repeats its reason


class Plant(Protocol):
    """Plant interface: physics behind the device, without protocol or clock."""

    @property
    def channels(self) -> tuple[Channel, ...]:
        """Channels of a row of `advance`, in order."""

    @property
    def rate_Hz(self) -> float:
        """Ticks per second of device time."""

    @property
    def plate_moving(self) -> bool:
        """True while the plate moves."""

    def set_rate(self, rate_Hz: float) -> None:
        """Set the ticks per second of device time."""

    def command_pwm(self, pwm_us: Array) -> None:
        """Apply pulses (n_rotors,): us."""

    def command_plate(self, z_m: float, x_m: float, tilt_rad: float) -> None:
        """Start moving the plate at stage speed; a StageError is sent as nak with its message."""

    def halt_plate(self) -> None:
        """Stop the plate where it is."""

    def tare(self) -> None:
        """Set the present load-cell reading as zero thrust."""

    def advance(self, n: int) -> Array:
        """Return the next n ticks (n, c), nan where a channel has no new value."""


class TickRows(NamedTuple):
    """Consecutive ticks: device time (n,): us, not wrapped; values (n, c)."""

    device_time_us: NDArray[np.int64]
    values: Array


class Firmware:
    """Guarded plant: executes commands, checks limits on every tick, stops without a host."""

    def __init__(self, plant: Plant, hello: Hello, now_s: float = 0.0) -> None:
        self.hello = hello
        self.rate_Hz = 0.0
        self.latched: wire.DeviceEvent | None = None
        self.pwm_us: Array = np.full(hello.n_rotors, hello.pwm_stop_us)
        self.limits: dict[str, float] = dict(hello.limits)
        self._plant = plant
        self._events: list[wire.DeviceEvent] = []
        self._host_s = now_s
        self._repeated_s = now_s
        self._device_us = 0.0
        self._target: tuple[float, float, float] | None = None
        self._moving = False
        self._columns = {name: _columns(name, plant.channels) for name in self.limits}
        plant.command_pwm(self.pwm_us)

    @property
    def device_time_us(self) -> int:
        """Device time of the last tick: us since power-up, not wrapped."""
        return int(self._device_us)

    def note_host(self, now_s: float) -> None:
        """Record that a valid line (any command or heartbeat) arrived at wall time `now_s`."""
        self._host_s = now_s

    def take_events(self) -> tuple[wire.DeviceEvent, ...]:
        """Return and clear the events since the last call, oldest first."""
        events, self._events = tuple(self._events), []
        return events

    def execute(self, command: wire.Command, now_s: float) -> wire.Reply:
        """Execute one command that arrived at wall time `now_s`."""
        self.note_host(now_s)
        match command:
            case wire.RequestHello():
                self._zero()
                self.rate_Hz = 0.0
                return wire.Reply(True)
            case wire.ArmDevice():
                return self._refuse_latched() or wire.Reply(True, fields=(self.hello.channel_hash,))
            case wire.SetPwm(pwm_us):
                return self._set_pwm(np.array(pwm_us, float))
            case wire.SendPlate(z_m, x_m, tilt_rad):
                return self._move(z_m, x_m, tilt_rad)
            case wire.RequestPlate():
                target = self._target or (np.nan, np.nan, np.nan)
                fields = ("" if np.isnan(v) else wire.format_number(v) for v in target)
                return wire.Reply(True, fields=(str(int(self._plant.plate_moving)), *fields))
            case wire.TareDevice():
                self._plant.tare()
                return wire.Reply(True)
            case wire.SetRate(rate_Hz):
                return self._set_rate(rate_Hz)
            case wire.SetLimit(name, value):
                return self._set_limit(name, value)
            case wire.StopDevice():
                self._zero()
                return wire.Reply(True)
            case wire.Clear():
                self._zero()
                self.latched = None
                return wire.Reply(True)

    def advance(self, n: int, now_s: float) -> TickRows:
        """Run n ticks that end at wall time `now_s`, with watchdog and limits.

        Limits are checked over the whole block, so n is the reaction time; 0 checks only the
        watchdog. A BenchtoolError of the plant is raised after the motors are stopped.
        """
        self._check_watchdog(now_s)
        if n == 0:
            return TickRows(np.empty(0, np.int64), np.empty((0, len(self.hello.channels))))
        try:
            values = self._plant.advance(n)
        except BenchtoolError as error:
            # The plant failed: stop the motors and report the reason to the host.
            self._latch(
                wire.DeviceEvent("limit", f"{str(error)[:MAX_REASON_LENGTH]}; motors stopped"),
                now_s,
            )
            raise
        step_us = 1e6 / self._plant.rate_Hz
        times_us = self._device_us + step_us * np.arange(1, n + 1)
        self._device_us += step_us * n
        self._check_limits(values, now_s)
        if self._moving and not self._plant.plate_moving:
            self._moving = False
            assert self._target is not None
            self._events.append(
                wire.DeviceEvent("arrived", ",".join(map(wire.format_number, self._target)))
            )
        return TickRows(times_us.astype(np.int64), values)

    def _zero(self) -> None:
        self.pwm_us = np.full(self.hello.n_rotors, self.hello.pwm_stop_us)
        self._plant.command_pwm(self.pwm_us)
        self._plant.halt_plate()
        self._moving = False

    def _latch(self, event: wire.DeviceEvent, now_s: float) -> None:
        self._zero()
        self.latched = event
        self._repeated_s = now_s
        self._events.append(event)

    def _check_watchdog(self, now_s: float) -> None:
        silent_s = now_s - self._host_s
        running = bool(np.any(self.pwm_us > self.hello.pwm_stop_us)) or self._moving
        if running and silent_s >= self.hello.watchdog_s:
            text = f"no line for {1000.0 * silent_s:.0f} ms; motors stopped"
            self._latch(wire.DeviceEvent("watchdog", text), now_s)
        elif self.latched is not None and now_s - self._repeated_s >= REPEAT_INTERVAL_S:
            self._repeated_s = now_s
            self._events.append(self.latched)

    def _check_limits(self, values: Array, now_s: float) -> None:
        if self.latched is not None:
            return
        for name, columns in self._columns.items():
            limit = self.limits[name]
            for index in columns:
                column = values[:, index]
                broken = column < limit if _is_lower_bound(name) else np.abs(column) > limit
                if broken.any():
                    worst = float(column[broken][0])
                    channel = self._plant.channels[index].name
                    text = f"{channel} {worst:.6g} against limit {limit:.6g}; motors stopped"
                    self._latch(wire.DeviceEvent("limit", text), now_s)
                    return

    def _set_pwm(self, pwm_us: Array) -> wire.Reply:
        stop_us, max_us = self.hello.pwm_stop_us, self.limits.get("pwm_us", np.inf)
        if len(pwm_us) != self.hello.n_rotors:
            return wire.Reply(False, f"{self.hello.n_rotors} pulses needed; {len(pwm_us)} given")
        if np.any((pwm_us < stop_us) | (pwm_us > max_us)):
            return wire.Reply(False, f"pulses must lie from {stop_us:g} to {max_us:g} us")
        if np.any(pwm_us > stop_us):
            if refused := self._refuse_latched():
                return refused
            if self._moving and np.any(pwm_us > self.hello.pwm_idle_us):
                return wire.Reply(False, "the plate is moving; wait until it has arrived")
        self.pwm_us = pwm_us
        self._plant.command_pwm(pwm_us)
        return wire.Reply(True)

    def _refuse_latched(self) -> wire.Reply | None:
        if self.latched is None:
            return None
        reason = f"{self.latched.kind}: {self.latched.text}"
        return wire.Reply(False, f"stopped by {reason}; send clear first")

    def _move(self, z_m: float, x_m: float, tilt_rad: float) -> wire.Reply:
        if not self.hello.moves_plate:
            return wire.Reply(False, "this device does not move the plate")
        if np.any(self.pwm_us > self.hello.pwm_idle_us):
            return wire.Reply(False, f"pulses above {self.hello.pwm_idle_us:g} us; idle them first")
        low_m = self.limits.get("plate_z_min_m", 0.0)
        high_m = self.limits.get("plate_z_max_m", np.inf)
        if not low_m <= z_m <= high_m:
            return wire.Reply(False, f"plate distance {z_m:g} m outside {low_m:g} to {high_m:g} m")
        side_m = self.limits.get("plate_x_max_m", np.inf)
        if not abs(x_m) <= side_m or not np.isfinite((x_m, tilt_rad)).all():
            return wire.Reply(
                False, f"lateral {x_m:g} m, tilt {tilt_rad:g} rad; limit {side_m:g} m"
            )
        try:
            self._plant.command_plate(z_m, x_m, tilt_rad)
        except BenchtoolError as error:
            return wire.Reply(False, str(error))
        self._target = (z_m, x_m, tilt_rad)
        self._moving = True
        return wire.Reply(True)

    def _set_rate(self, rate_Hz: float) -> wire.Reply:
        if not 0.0 <= rate_Hz <= MAX_RATE_HZ:
            return wire.Reply(False, f"rate {rate_Hz:g} Hz outside 0 to {MAX_RATE_HZ:g} Hz")
        if rate_Hz > 0.0:
            try:
                self._plant.set_rate(rate_Hz)
            except BenchtoolError as error:
                return wire.Reply(False, str(error))
        self.rate_Hz = rate_Hz
        return wire.Reply(True)

    def _set_limit(self, name: str, value: float) -> wire.Reply:
        if name not in self.limits:
            return wire.Reply(False, f"no limit {name}; known: {' '.join(sorted(self.limits))}")
        present = self.limits[name]
        wider = value < present if _is_lower_bound(name) else value > present
        if wider:
            return wire.Reply(
                False, f"{name} {value:g} is wider than {present:g}; only narrower ones"
            )
        self.limits[name] = value
        return wire.Reply(True)


def _is_lower_bound(name: str) -> bool:
    return "_min_" in name


def _columns(name: str, channels: tuple[Channel, ...]) -> tuple[int, ...]:
    """Return the channels under a limit (`rpm`: rpm1, rpm2 ...); none for a command's limit."""
    if name == "pwm_us" or name.startswith("plate_"):
        return ()
    family = name.replace("_min_", "_").replace("_max_", "_")
    return tuple(
        index
        for index, channel in enumerate(channels)
        if channel.name == family or channel.name.rstrip("0123456789") == family
    )
