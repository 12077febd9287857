"""Driver of a flight controller: `mavlink:` addresses.

Motor commands expire after a quarter of a second and are repeated while the bench is read, never by
a thread: if the host's control loop hangs, its motors stop. The outputs are read back, because an
acknowledgement does not show that motors turn or stop.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable

import numpy as np

from benchtool.bench.bench import DeviceInfo, Readings, StreamingBench
from benchtool.bench.clocks import DeviceClock
from benchtool.bench.drivers import MAX_HZ, MIN_HZ, MavlinkAddress, build_transport
from benchtool.bench.mavlink import streams
from benchtool.bench.mavlink.autopilots import DETECTION_TIMEOUT_S, AutopilotInfo, read_autopilot
from benchtool.bench.mavlink.auxiliary_load_cell import AuxiliaryLoadCell, merge_in_order
from benchtool.bench.mavlink.drive import Health, MotorDrive, PitchDrive, RunMonitor
from benchtool.bench.mavlink.frames import MavlinkFrames, MavlinkQuality, Message, interval
from benchtool.bench.mavlink.link import MavlinkLink
from benchtool.bench.mavlink.motor_test import MotorTestDrive
from benchtool.bench.mavlink.rows import MavlinkRows
from benchtool.bench.mavlink.settings import (
    THRUST_MESSAGES,
    MavlinkSettings,
    live_channels,
    parse_settings,
)
from benchtool.bench.transport.ports import SerialPort
from benchtool.bench.transport.transport import Transport
from benchtool.core.channel import Channel
from benchtool.core.errors import BenchError, InputError, LinkLost, StageError
from benchtool.core.units import Array

PLATE_RETRY_INTERVAL_S = 0.5  # until a plate command is acknowledged
ARRIVAL_TIMEOUT_S = 120.0
MOVING, ARRIVED, REFUSED = 1.0, 0.0, -1.0  # values of `plate_mov`
TARE_S = 1.0  # bench time over which a tare averages: 80 readings; assumed


class MavlinkBench(StreamingBench):
    """Bench behind an autopilot, which turns the motors and reports the readings."""

    def __init__(
        self,
        transport: Transport,
        address: str,
        settings: MavlinkSettings | None = None,
        clock: Callable[[], float] = time.monotonic,
        since_1970_s: Callable[[], float] = time.time,
        cell: Transport | None = None,
    ) -> None:
        super().__init__(address)
        self._transport, self._clock, self._since_1970_s = transport, clock, since_1970_s
        self._settings = settings or MavlinkSettings()
        name, _ = self._settings.cell or ("its port", 0)
        self._cell = AuxiliaryLoadCell(cell, name, clock) if cell else None
        self._ports = [transport] if cell is None else [transport, cell]
        self._autopilot: AutopilotInfo | None = None
        self._channels: tuple[Channel, ...] = ()
        self._rate_Hz = self._settings.rate_Hz

    @property
    def identity(self) -> DeviceInfo:
        autopilot = self._require_autopilot()
        facts = {
            "system": str(self._link.system),
            **streams.stream_facts(self._states),
            **self._quality.facts(),
        }
        return autopilot.identity(
            self._settings,
            facts,
            address=self.address,
            channels=self._channels,
            rate_Hz=self._rate_Hz,
            longest_delay_s=self._speed * max(self._link.slowest_s, DETECTION_TIMEOUT_S),
        )

    def now_s(self) -> float:
        return self._bench_s(self._clock())

    def open(self) -> None:
        if self._autopilot is not None:
            return
        settings = self._settings
        frames = MavlinkFrames(key=settings.key, now_s=self._since_1970_s())
        self._link = link = MavlinkLink(self._transport, self.address, self._clock, frames)
        self._opened_s = self._stamped_s = self._clock()
        self._speed = 1.0
        self._quality = MavlinkQuality()
        self._counts: Counter[str] = Counter()
        self._messages: list[str] = [settings.warning] if settings.warning else []
        self._plate_states: list[float] = []  # received values of `plate_mov`, oldest first
        self._zero_N = 0.0
        self._last_returned_us = -1
        self._clear_buffer()
        try:
            if self._cell is not None:
                self._cell.open()
            heartbeat = link.find(settings.system)
            autopilot = read_autopilot(link, heartbeat, settings)
            self._speed, self._device_clock = autopilot.speed, DeviceClock(autopilot.speed)
            self._rows = MavlinkRows(
                autopilot.wiring, settings, autopilot.pulses.idle_us, autopilot.simulated
            )
            kind = PitchDrive if settings.mode == "pitch" else MotorTestDrive
            self._health = Health(kind is PitchDrive or autopilot.pilot.arms)
            self._drive: MotorDrive = kind(link, autopilot, self._health, settings.arm)
            link.on_message = self._process_message
            n = autopilot.wiring.n_rotors
            self._baud = 0 if autopilot.simulated else self._transport.baud or 0
            fitted_settings, warnings = streams.fit_rates(settings, n, self._baud)
            self._rate_Hz, self._messages = fitted_settings.rate_Hz, [*self._messages, *warnings]
            requests = streams.stream_requests(fitted_settings, n)
            self._states = streams.request_streams(link, requests, self._counts, self._speed)
            if self._baud:
                self._messages += streams.disable_other_streams(link, self._counts, self._states)
            if link.slowest_s > streams.LATE_TIMEOUT_S:
                self._messages.append(
                    f"acknowledgements take up to {link.slowest_s:.1f} s: the link is overloaded; "
                    f"reduce the streams (rate=, rpm=none), or raise its baud rate"
                )
            self._choose_channels(autopilot)
            link.frames.take_counts(link.system)
            self._monitor = RunMonitor(link, self._health, self._drive, self._rows)
            outputs = streams.streaming_messages(self._states, *streams.OUTPUT_MESSAGES)
            self._monitor.restart_commands = [interval(name, self._rate_Hz) for name in outputs]
            self._autopilot = autopilot
        except BaseException:
            for port in self._ports:
                port.close()
            raise

    def close(self) -> None:
        if self._autopilot is None:
            return
        try:
            self._drive.release()
            for name in streams.streaming_messages(self._states):
                self._link.send_command(interval(name, 0.0))
        except BenchError:
            pass  # the timeout of the motor test stops the motors
        finally:
            for port in self._ports:
                port.close()
            self._autopilot = None

    def set_pwm(self, pwm_us: Array) -> None:
        autopilot = self._require_autopilot()
        self._monitor.raise_if_stopped()
        pulses = np.asarray(pwm_us, float).ravel()
        if len(pulses) != autopilot.wiring.n_rotors or not np.isfinite(pulses).all():
            raise InputError(
                f"pulse widths {pulses.tolist()} us are invalid, command not sent; needed: "
                f"{autopilot.wiring.n_rotors} finite values, one for each rotor"
            )
        low_us, high_us = autopilot.pulses.stop_us, autopilot.pulses.high_us
        if (pulses < low_us).any() or (pulses > high_us).any():
            raise InputError(
                f"pulse widths {pulses.tolist()} us are out of range, command not sent; allowed by "
                f"the autopilot's outputs: {low_us:g} to {high_us:g} us"
            )
        self._drive.command(tuple(pulses.tolist()))

    def stop(self) -> None:
        self._require_autopilot()
        self._drive.stop()

    def move_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        autopilot = self._require_autopilot()
        self._monitor.raise_if_stopped()
        if not autopilot.simulated:
            raise StageError(
                "an autopilot does not move the plate; use --stage hand or --stage grbl:PORT"
            )
        idle_us = autopilot.pulses.idle_us
        if (highest_us := self._drive.max_pulse_us) > idle_us:
            raise StageError(
                f"the plate was not moved: a motor is commanded to {highest_us:g} us, above idle "
                f"at {idle_us:g} us; command idle first"
            )
        # The plate of a virtual autopilot is moved by named values.
        build_message = self._link.dialect.MAVLink_named_value_float_message
        start_s, sent_s, is_moving = self.now_s(), -1e9, False
        while (now_s := self.now_s()) - start_s < ARRIVAL_TIMEOUT_S:
            if not is_moving and now_s - sent_s >= PLATE_RETRY_INTERVAL_S:
                sent_s = now_s
                for axis, value in (("x", x_m), ("tilt", tilt_rad), ("z", z_m)):
                    self._link.send(build_message(0, f"plate_{axis}".encode(), value))
            self._buffer_readings(self._read_fresh(0.05))
            states, self._plate_states = self._plate_states, []
            for state in states:
                if state == REFUSED:
                    text = self._health.refusal or "no reason reported"
                    raise StageError(f"the plate was not moved: {text}")
                is_moving = is_moving or state == MOVING
                if is_moving and state == ARRIVED:
                    return
        self._link.send(build_message(0, b"plate_halt", 1.0))
        raise StageError(
            f"the plate did not reach {z_m:g} m within {ARRIVAL_TIMEOUT_S:g} s and was stopped; "
            f"check the virtual bench"
        )

    def tare(self) -> None:
        """Tare to the mean of the load cell over a second, because autopilots have no tare."""
        self._require_autopilot()
        if self._thrust_column < 0:
            raise InputError("this bench streams no thrust; a tare needs a load cell")
        parts = []
        deadline_s = self.now_s() + TARE_S
        while (left_s := deadline_s - self.now_s()) > 1e-9:
            readings = self._read_fresh(left_s)
            self._buffer_readings(readings)
            parts.append(readings.values[:, self._thrust_column])
        thrust = np.concatenate(parts) if parts else np.empty(0)
        if np.isfinite(thrust).any():
            self._zero_N += float(np.nanmean(thrust))

    def set_rate(self, rate_Hz: float) -> None:
        n_rotors = self._require_autopilot().wiring.n_rotors
        if not MIN_HZ <= rate_Hz <= MAX_HZ:
            raise InputError(
                f"stream rate {rate_Hz:g} Hz is out of range; allowed: {MIN_HZ:g} to {MAX_HZ:g} Hz"
            )
        streams.check_fit(self._settings, rate_Hz, n_rotors, self._baud)
        fast_messages = (*streams.OUTPUT_MESSAGES, "ATTITUDE", "ATTITUDE_TARGET")
        for name in streams.streaming_messages(self._states, *fast_messages):
            self._link.exchange(interval(name, rate_Hz))
        self._rate_Hz = rate_Hz

    def read(self, timeout_s: float) -> Readings:
        self._require_autopilot()
        buffered = self._take_buffered()
        return self._publish(self._read_fresh(timeout_s)) if buffered is None else buffered

    def _read_fresh(self, timeout_s: float) -> Readings:
        deadline_s = self._clock() + timeout_s / self._speed
        while True:
            readings = self._build_readings()
            if len(readings):
                return readings
            # Samples read before a stop are returned first, so that none is lost.
            self._monitor.raise_if_stopped(repeat=False)
            left_s = deadline_s - self._clock()
            if left_s <= 0.0:
                return readings
            if readings.lost or readings.corrupt:
                self._buffer_readings(readings)
            self._monitor.pump(left_s)
            if self._cell is not None:
                self._cell.poll()

    def outputs_us(self) -> tuple[float, ...]:
        """Return the pulse width of every output, 0 for an output without pulses."""
        return self._rows.outputs_us

    def speeds_rpm(self) -> dict[int, float]:
        """Return the last reported speed of each ESC, by its number from 1."""
        return dict(self._rows.speeds_rpm)

    def _require_autopilot(self) -> AutopilotInfo:
        if self._autopilot is None:
            raise LinkLost(f"{self.address} is not open; call open() first")
        return self._autopilot

    def _choose_channels(self, autopilot: AutopilotInfo) -> None:
        """Select the channels with values; add warnings about missing messages."""
        streams.require_outputs(self._states, self._link.system)
        self._rows.take_rows()
        live_columns, n = self._rows.live_columns().tolist(), autopilot.wiring.n_rotors
        channels = live_channels(self._settings.mode, n, live_columns, cell=self._cell is not None)
        self._columns = np.array(list(channels), np.intp)
        self._channels = tuple(channels.values())
        names = [channel.name for channel in self._channels]
        self._thrust_column = names.index("thrust_N") if "thrust_N" in names else -1
        # Texts about unsupported messages are replaced by the warnings below.
        missing = "No ap_message for mavlink id"
        self._health.texts[:] = [t for t in self._health.texts if not t.startswith(missing)]
        self._messages += streams.silent_messages(self._states)

    def _process_message(self, message: Message, arrived_s: float) -> None:
        name, is_own = message.msgname, self._link.is_own(message)
        if is_own or name in THRUST_MESSAGES:
            self._counts[name] += 1
        if name == "STATUSTEXT":
            self._health.process_text(message, is_own)
        elif not is_own:
            self._rows.update(message, self._device_us(arrived_s))
        elif name == "HEARTBEAT":
            self._health.process_heartbeat(message, arrived_s, self._drive.outputs_match())
        elif name == "NAMED_VALUE_FLOAT" and message.name == "plate_mov":
            self._plate_states.append(float(message.value))
        else:
            self._rows.update(message)
            if name in streams.OUTPUT_MESSAGES:
                self._stamped_s = arrived_s
                self._device_clock.update(self._rows.time.last_us, self._bench_s(arrived_s))
                wired = self._drive.update_outputs(self._rows.outputs_us, arrived_s)
                if wired is not None:
                    self._rows.assign_output(*wired)
                    self._messages.append(f"rotor {wired[0]} is driven by output {wired[1]}")
                device_s = 1e-6 * self._rows.time.last_us
                self._quality.arrived(arrived_s, device_s / self._speed)

    def _device_us(self, arrived_s: float) -> int:
        """Return the autopilot's time when a message of another component arrived."""
        since_s = max(arrived_s - self._stamped_s, 0.0) * self._speed
        return self._rows.time.last_us + round(1e6 * since_s)

    def _bench_s(self, wall_s: float) -> float:
        return self._opened_s + (wall_s - self._opened_s) * self._speed

    def _build_readings(self) -> Readings:
        """Return the received rows in host time."""
        times_us, values = self._rows.take_rows()
        values = values[:, self._columns]
        has_value = ~np.isnan(values).all(axis=1)
        times_us, values = times_us[has_value], values[has_value]
        if self._cell is not None and self._last_returned_us + len(times_us) >= 0:
            columns = [self._thrust_column + 1, self._thrust_column]
            cell = self._cell.rows(self._bench_s, self._device_clock, len(self._channels), columns)
            cell[1][:, self._thrust_column] *= self._settings.thrust_scale_N
            times_us, values = merge_in_order((times_us, values), cell, self._last_returned_us)
        if len(times_us):
            self._last_returned_us = int(times_us[-1])
        if self._thrust_column >= 0:
            values[:, self._thrust_column] -= self._zero_N
        counts = self._link.frames.take_counts(self._link.system)
        self._quality.counts.add(counts)
        self._messages += self._health.texts
        self._messages += self._rows.speeds.take_messages()
        self._health.texts.clear()
        messages: tuple[str, ...] = ()
        if len(times_us):
            messages, self._messages = tuple(self._messages), []
        return Readings(
            time_s=self._device_clock.host_time_s(times_us),
            device_time_us=times_us.astype(float),
            values=values,
            lost=counts.lost,
            corrupt=counts.corrupt,
            messages=messages,
        )


def open_mavlink(address: MavlinkAddress) -> MavlinkBench:
    """Return the bench behind an autopilot, not opened yet."""
    settings = parse_settings(address)
    cell = SerialPort(*settings.cell) if settings.cell else None
    return MavlinkBench(build_transport(address), address.text, settings, cell=cell)
