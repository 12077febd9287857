"""A flight controller as the bench: `mavlink:` addresses.

Orders to turn end by themselves after a quarter of a second and are sent again by whoever reads,
never by a thread: a host whose control loop hangs falls silent, and its motors stop. What the
motors do is read back from the outputs, because an acknowledgement proves nothing.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchtool.bench.addresses import MAX_RATE_HZ, MIN_RATE_HZ, MavlinkAddress
from benchtool.bench.bench import DeviceInfo, Readings, StreamingBench
from benchtool.bench.clocks import DeviceClock
from benchtool.bench.mavlink import streams
from benchtool.bench.mavlink.autopilots import DETECTION_TIMEOUT_S, AutopilotInfo, read_autopilot
from benchtool.bench.mavlink.auxiliary_load_cell import AuxiliaryLoadCell, merge_in_order
from benchtool.bench.mavlink.drive import MotorDrive, PitchDrive, RunWatch
from benchtool.bench.mavlink.frames import MavlinkFrames, MavlinkQuality
from benchtool.bench.mavlink.health import Health
from benchtool.bench.mavlink.link import MavlinkLink
from benchtool.bench.mavlink.messages import Message, interval
from benchtool.bench.mavlink.motor_test import TestDrive
from benchtool.bench.mavlink.rows import MavlinkRows
from benchtool.bench.mavlink.settings import (
    THRUST_MESSAGES,
    MavlinkSettings,
    live_channels,
    open_transport,
    parse_settings,
)
from benchtool.bench.transport.transport import Transport
from benchtool.core.array_type import Array
from benchtool.core.channel import Channel
from benchtool.core.errors import BenchError, InputError, LinkLost, StageError

TARE_S = 1.0  # bench time of a tare's mean: 80 readings; assumed


class MavlinkBench(StreamingBench):
    """Drive motors through an autopilot and read what it reports.

    Args:
        since_1970_s: wall clock for signatures.
    """

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
        autopilot = self._known()
        facts = {
            "system": str(self._link.system),
            **streams.stream_facts(self._states),
            **self._quality.facts(),
        }
        return replace(
            autopilot.identity(self._settings, facts),
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
        self._zero_N = 0.0
        self._given_us = -1
        self._clear_buffer()
        try:
            if self._cell is not None:
                self._cell.open()
            beat = link.find(settings.system)
            autopilot = read_autopilot(link, beat, settings, self._clock)
            self._speed, self._device_clock = autopilot.speed, DeviceClock(autopilot.speed)
            self._rows = MavlinkRows(autopilot.wiring, autopilot.pulses.idle_us, settings.speeds)
            made = PitchDrive if settings.mode == "pitch" else TestDrive
            self._health = Health(made is PitchDrive or autopilot.pilot.arms)
            self._drive: MotorDrive = made(link, autopilot, self._health, settings.arm, self._clock)
            self._plate = VirtualPlate(link, self.now_s)
            link.on_message = self._take
            n = autopilot.wiring.n_rotors
            self._baud = 0 if autopilot.simulated else self._transport.baud or 0
            fitting, remarks = streams.fit_rates(settings, n, self._baud)
            self._rate_Hz, self._messages = fitting.rate_Hz, [*self._messages, *remarks]
            self._states = streams.request_streams(
                link, streams.stream_requests(fitting, n), self._counts.__getitem__,
                self._clock, self._speed,
            )  # fmt: skip
            if self._baud:
                self._messages += streams.disable_other_streams(link, self._counts, self._states)
            if link.slowest_s > streams.LATE_TIMEOUT_S:
                self._messages.append(
                    f"acknowledgements take up to {link.slowest_s:.1f} s: the link carries more "
                    f"than it can; ask for less (rate=, rpm=none), or raise its baud rate"
                )
            self._choose_channels(autopilot)
            link.frames.take_counts(link.system)
            self._watch = RunWatch(self.address, link, self._health, self._drive, self._rows)
            outputs = streams.streaming_messages(self._states, *streams.OUTPUT_MESSAGES)
            self._watch.request_again = [interval(name, self._rate_Hz) for name in outputs]
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
                self._link.order(interval(name, 0.0))
        except BenchError:
            pass  # The time-out of the motor test stops the motors where we cannot.
        finally:
            for port in self._ports:
                port.close()
            self._autopilot = None

    def set_pwm(self, pwm_us: Array) -> None:
        autopilot = self._known()
        self._watch.raise_if_stopped()
        pulses = np.asarray(pwm_us, float).ravel()
        if len(pulses) != autopilot.wiring.n_rotors or not np.isfinite(pulses).all():
            raise InputError(
                f"pulses {pulses.tolist()} were not sent; {autopilot.wiring.n_rotors} finite ones "
                f"are needed, one for each rotor"
            )
        low_us, high_us = autopilot.pulses.stop_us, autopilot.pulses.high_us
        if (pulses < low_us).any() or (pulses > high_us).any():
            raise InputError(
                f"pulses {pulses.tolist()} were not sent; the autopilot's outputs go from "
                f"{low_us:g} to {high_us:g} us"
            )
        self._drive.command(tuple(pulses.tolist()))

    def stop(self) -> None:
        self._known()
        self._drive.stop()

    def move_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        autopilot = self._known()
        self._watch.raise_if_stopped()
        if not autopilot.simulated:
            raise StageError(
                "an autopilot does not move the plate; give --stage hand or --stage grbl:PORT"
            )
        idle_us = autopilot.pulses.idle_us
        if (highest_us := self._drive.highest_us) > idle_us:
            raise StageError(
                f"the plate was not moved: a motor is commanded {highest_us:g} us, above idle at "
                f"{idle_us:g} us; command idle first"
            )
        self._plate.move(
            (z_m, x_m, tilt_rad),
            lambda: self._buffer_readings(self._read_fresh(0.05)),
            lambda: self._health.refusal,
        )

    def tare(self) -> None:
        """Take the mean of the load cell over a second as zero: autopilots have no tare."""
        self._known()
        if self._thrust < 0:
            raise InputError("this bench streams no thrust, so there is nothing to tare")
        parts = []
        until_s = self.now_s() + TARE_S
        while (left_s := until_s - self.now_s()) > 1e-9:
            readings = self._read_fresh(left_s)
            self._buffer_readings(readings)
            parts.append(readings.values[:, self._thrust])
        seen = np.concatenate(parts) if parts else np.empty(0)
        if np.isfinite(seen).any():
            self._zero_N += float(np.nanmean(seen))

    def set_rate(self, rate_Hz: float) -> None:
        self._known()
        if not MIN_RATE_HZ <= rate_Hz <= MAX_RATE_HZ:
            raise InputError(
                f"stream rate {rate_Hz:g} Hz is out of range; allowed: {MIN_RATE_HZ:g} to "
                f"{MAX_RATE_HZ:g} Hz"
            )
        streams.check_fit(self._settings, rate_Hz, self._known().wiring.n_rotors, self._baud)
        swift = (*streams.OUTPUT_MESSAGES, "ATTITUDE", "ATTITUDE_TARGET")
        for name in streams.streaming_messages(self._states, *swift):
            self._link.exchange(interval(name, rate_Hz))
        self._rate_Hz = rate_Hz

    def read(self, timeout_s: float) -> Readings:
        self._known()
        return self._take_buffered_or_read(lambda: self._read_fresh(timeout_s))

    def _read_fresh(self, timeout_s: float) -> Readings:
        deadline_s = self._clock() + timeout_s / self._speed
        while True:
            readings = self._readings()
            if len(readings):
                return readings
            # What was read before a stop is handed out first: no sample is lost to it.
            self._watch.raise_if_stopped(again=False)
            left_s = deadline_s - self._clock()
            if left_s <= 0.0:
                return readings
            if readings.lost or readings.corrupt:
                self._buffer_readings(readings)
            self._watch.pump(left_s)
            if self._cell is not None:
                self._cell.poll()

    def outputs_us(self) -> tuple[float, ...]:
        """Return the pulse of every output, 0 where there is none."""
        return self._rows.outputs_us

    def speeds_rpm(self) -> dict[int, float]:
        """Return the speed that each ESC last reported, by its place from 1."""
        return dict(self._rows.speeds_rpm)

    def _known(self) -> AutopilotInfo:
        if self._autopilot is None:
            raise LinkLost(f"{self.address} is not open; open it first")
        return self._autopilot

    def _choose_channels(self, autopilot: AutopilotInfo) -> None:
        """Choose the channels that live; note which messages do not come."""
        streams.require_outputs(self._states, self._link.system)
        self._rows.take_rows()
        live, n = self._rows.live_columns().tolist(), autopilot.wiring.n_rotors
        channels = live_channels(self._settings.mode, n, live, cell=self._cell is not None)
        self._columns = np.array(list(channels), np.intp)
        self._channels = tuple(channels.values())
        names = [channel.name for channel in self._channels]
        self._thrust = names.index("thrust_N") if "thrust_N" in names else -1
        # What it says of messages that it does not have is reported once, below.
        denied = "No ap_message for mavlink id"
        self._health.texts[:] = [t for t in self._health.texts if not t.startswith(denied)]
        self._messages += streams.silent_messages(self._states)

    def _take(self, message: Message, arrived_s: float) -> None:
        name, own = message.msgname, self._link.is_own(message)
        if own or name in THRUST_MESSAGES:
            self._counts[name] += 1
        if name == "STATUSTEXT":
            self._health.text(message, own)
        elif not own:
            self._rows.take(message, self._device_us(arrived_s))
        elif name == "HEARTBEAT":
            self._health.beat(message, arrived_s, self._drive.shown())
        elif name == "NAMED_VALUE_FLOAT" and message.name == "plate_mov":
            self._plate.states.append(float(message.value))
        else:
            self._rows.take(message)
            if name in streams.OUTPUT_MESSAGES:
                self._stamped_s = arrived_s
                self._device_clock.learn(self._rows.time.last_us, self._bench_s(arrived_s))
                found = self._drive.seen(self._rows.outputs_us, arrived_s)
                if found is not None:
                    self._rows.wire(*found)
                    self._messages.append(f"rotor {found[0]} hangs on output {found[1]}")
                device_s = 1e-6 * self._rows.time.last_us
                self._quality.arrived(arrived_s, device_s / self._speed)

    def _device_us(self, arrived_s: float) -> int:
        """Return the autopilot's time at which something of another component arrived."""
        since_s = max(arrived_s - self._stamped_s, 0.0) * self._speed
        return self._rows.time.last_us + round(1e6 * since_s)

    def _bench_s(self, wall_s: float) -> float:
        return self._opened_s + (wall_s - self._opened_s) * self._speed

    def _readings(self) -> Readings:
        """Return the rows that have come, on the host's clock."""
        times_us, values = self._rows.take_rows()
        values = values[:, self._columns]
        some = ~np.isnan(values).all(axis=1)
        times_us, values = times_us[some], values[some]
        if self._cell is not None and self._given_us + len(times_us) >= 0:
            columns = [self._thrust + 1, self._thrust]
            cell = self._cell.rows(self._bench_s, self._device_clock, len(self._channels), columns)
            cell[1][:, self._thrust] *= self._settings.thrust_scale_N
            times_us, values = merge_in_order((times_us, values), cell, self._given_us)
        if len(times_us):
            self._given_us = int(times_us[-1])
        if self._thrust >= 0:
            values[:, self._thrust] -= self._zero_N
        counted = self._link.frames.take_counts(self._link.system)
        self._quality.counts.add(counted)
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
            lost=counted.lost,
            corrupt=counted.corrupt,
            messages=messages,
        )


def open_mavlink(address: MavlinkAddress) -> MavlinkBench:
    """Return the bench behind an autopilot, not opened yet."""
    from benchtool.bench.transport.serial_port import SerialPort

    settings = parse_settings(address)
    cell = SerialPort(*settings.cell) if settings.cell else None
    return MavlinkBench(open_transport(address), address.text, settings, cell=cell)


AGAIN_S = 0.5  # A plate order that was not acknowledged is sent again after so long

ARRIVE_S = 120.0

MOVING, THERE, REFUSED = 1.0, 0.0, -1.0  # Values of `plate_mov`


class VirtualPlate:
    """Plate of a virtual autopilot's world, moved by named values; a real autopilot has none.

    Attributes:
        states: values of `plate_mov` that have come, oldest first.
    """

    def __init__(self, link: MavlinkLink, now_s: Callable[[], float]) -> None:
        self.states: list[float] = []
        self._link, self._now_s = link, now_s

    def move(
        self,
        place: tuple[float, float, float],
        listen: Callable[[], None],
        refusal: Callable[[], str],
    ) -> None:
        """Move it to a distance m, lateral position m and tilt rad, listening all the while."""
        made = self._link.words.MAVLink_named_value_float_message
        begun_s, sent_s, moving = self._now_s(), -1e9, False
        while (now_s := self._now_s()) - begun_s < ARRIVE_S:
            if not moving and now_s - sent_s >= AGAIN_S:
                sent_s = now_s
                z_m, x_m, tilt_rad = place
                for axis, value in (("x", x_m), ("tilt", tilt_rad), ("z", z_m)):
                    self._link.send(made(0, f"plate_{axis}".encode(), value))
            listen()
            states, self.states = self.states, []
            for state in states:
                if state == REFUSED:
                    text = refusal() or "it does not say why"
                    raise StageError(f"the plate stays where it is: {text}")
                moving = moving or state == MOVING
                if moving and state == THERE:
                    return
        self._link.send(made(0, b"plate_halt", 1.0))
        raise StageError(
            f"the plate did not reach {place[0]:g} m within {ARRIVE_S:g} s and was halted; look at "
            f"the virtual bench"
        )
