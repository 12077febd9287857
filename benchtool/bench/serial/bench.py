"""Driver of the bench protocol: `serial:` and `tcp:` addresses.

Only `read` and commands send heartbeats, never a separate thread. If the host's control loop hangs,
heartbeats must stop, so that the device's watchdog stops the motors. The host must therefore read
at least every `identity.watchdog_s` while motors turn.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchtool.bench.bench import DeviceInfo, Readings, StreamingBench
from benchtool.bench.drivers import SerialAddress, TcpAddress, build_transport
from benchtool.bench.serial import commands as wire
from benchtool.bench.serial.command_channel import CommandChannel
from benchtool.bench.serial.hello import Hello, check_rate, max_rate_Hz
from benchtool.bench.transport.transport import Transport
from benchtool.core.errors import (
    BenchError,
    CommandRefused,
    DeviceStopped,
    LinkLost,
    ProtocolError,
    StageError,
)
from benchtool.core.units import Array

STALE_TIMEOUT_S = 1.0  # wall time without data after which the link is lost: 4 watchdogs; assumed
PLATE_POLL_INTERVAL_S = 0.5  # of state requests while the plate moves: `arrived` may be lost

ARRIVAL_TIMEOUT_S = 120.0  # of the plate, bench time

STOP_ATTEMPTS = 3


class SerialBench(StreamingBench):
    """Bench that speaks the bench protocol.

    Bench time is wall time multiplied by the speed that a virtual device reports in its hello;
    every `timeout_s` is bench time. Link timeouts and the watchdog are wall time.
    """

    def __init__(
        self, transport: Transport, address: str, clock: Callable[[], float] = time.monotonic
    ) -> None:
        super().__init__(address)
        self._channel = CommandChannel(transport, address, clock, self._receive_readings)
        self._clock = clock
        self._hello: Hello | None = None
        self._rate_Hz = 0.0
        self._messages: list[str] = []
        self._silent_since_s: float | None = None
        self._stopped: str | None = None
        self._is_stop_reported = False
        self._armed = False
        self._arrived = False
        self._stage_fault: str | None = None

    @property
    def identity(self) -> DeviceInfo:
        return self._require_hello().identity(self.address, self._rate_Hz)

    def now_s(self) -> float:
        return self._channel.now_s()

    def open(self) -> None:
        if self._hello is not None:
            return
        self._clear_buffer()
        try:
            self._hello = self._channel.open()
            self.clear()
            self._messages.clear()
            rate_Hz = self._hello.rate_Hz
            if baud := self._baud():
                max_Hz = max_rate_Hz(self._hello.frame_bytes, baud)
                rate_Hz = min(rate_Hz, max_Hz / self._hello.speed)
            self._start_stream(rate_Hz)
        except BaseException:
            self._channel.close()
            self._hello = None
            raise

    def close(self) -> None:
        if self._hello is None:
            return
        try:
            self._channel.exchange(wire.StopDevice(), STOP_ATTEMPTS)
            self._channel.exchange(wire.SetRate(0.0), STOP_ATTEMPTS)
        except BenchError:
            pass  # the device's watchdog stops the motors
        finally:
            self._channel.close()
            self._hello = None

    def set_pwm(self, pwm_us: Array) -> None:
        self._raise_if_stopped()
        pulses = np.asarray(pwm_us, float).ravel()
        has_motion = bool((pulses > self._require_hello().pwm_stop_us).any())
        if has_motion:
            self._arm()
        try:
            self._send_command(wire.SetPwm(tuple(pulses.tolist())), has_motion)
        except CommandRefused:
            self._armed = False  # perhaps stopped by another thread; the next command arms again
            raise

    def stop(self) -> None:
        self._armed = False
        self._send_command(wire.StopDevice())

    def halt(self) -> None:
        """Send zero immediately, from any thread (`SupportsEmergencyStop`)."""
        self._channel.halt()

    def move_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        self._raise_if_stopped()
        self._arm()
        self._arrived, self._stage_fault = False, None
        reply = self._channel.exchange(wire.SendPlate(z_m, x_m, tilt_rad), moves=True)
        if not reply.ok:
            self._armed = False
            if reply.reason.startswith(wire.LATE_REASON):  # no fault of the stage
                raise _rejection(wire.SendPlate(z_m, x_m, tilt_rad), reply.reason)
            raise StageError(f"the stage rejected the move to {z_m:g} m: {reply.reason}")
        start_s = requested_s = self._clock()
        while not self._arrived:
            self._channel.pump(0.05)
            self._process_events()
            self._raise_if_stopped()
            if self._stage_fault is not None:
                raise StageError(f"the stage did not reach {z_m:g} m: {self._stage_fault}")
            now_s = self._clock()
            if (now_s - start_s) * self._require_hello().speed > ARRIVAL_TIMEOUT_S:
                self.stop()
                raise StageError(
                    f"the plate did not reach {z_m:g} m within {ARRIVAL_TIMEOUT_S:g} s and "
                    f"was stopped; check for an obstacle"
                )
            if now_s - requested_s > PLATE_POLL_INTERVAL_S and not self._arrived:
                requested_s = now_s
                fields = self._channel.exchange(wire.RequestPlate()).fields
                if fields[:1] == ("0",):
                    self._arrived = True

    def tare(self) -> None:
        self._send_command(wire.TareDevice())

    def set_limit(self, name: str, value: float) -> None:
        """Narrow one limit on the device, which rejects a wider one."""
        self._send_command(wire.SetLimit(name, value))

    def clear(self) -> None:
        """Clear the latch of a device that stopped its motors; they stay at zero."""
        self._armed = False
        self._send_command(wire.Clear())
        self._process_events()
        self._stopped, self._is_stop_reported = None, False

    def set_rate(self, rate_Hz: float) -> None:
        hello = self._require_hello()
        check_rate(rate_Hz * hello.speed, hello.frame_bytes, self._baud())
        self._start_stream(rate_Hz)

    def read(self, timeout_s: float) -> Readings:
        speed = self._require_hello().speed
        deadline_s = self._clock() + timeout_s / speed
        while True:
            self._process_events()
            # Before the samples, which later reads return: some may already show motors at
            # standstill although the host last commanded a pulse width above stop.
            if not self._is_stop_reported:
                self._raise_if_stopped()
            if (buffered := self._take_buffered()) is not None:
                self._silent_since_s = None
                return buffered
            left_s = deadline_s - self._clock()
            if left_s <= 0.0:
                messages, self._messages = tuple(self._messages), []
                values, empty = np.empty((0, len(self._require_hello().channels))), np.empty(0)
                return self._publish(Readings(empty, empty, values, messages=messages))
            if not self._channel.pump(left_s):
                self._check_silence()

    def _require_hello(self) -> Hello:
        if self._hello is None:
            raise LinkLost(f"{self.address} is not open; call open() first")
        return self._hello

    def _baud(self) -> int:
        """Return the rate of the slower end's serial line, 0 if there is no limit."""
        device_baud = self._require_hello().baud
        host_baud = self._channel.transport.baud
        return min(device_baud, host_baud) if device_baud and host_baud else device_baud

    def _send_command(self, command: wire.Command, moves: bool = False) -> None:
        self._require_hello()
        reply = self._channel.exchange(command, moves=moves)
        if not reply.ok:
            raise _rejection(command, reply.reason)

    def _arm(self) -> None:
        """Arm the device if it was stopped; raise if its channels differ from its hello."""
        hello = self._require_hello()
        if self._armed:
            return
        reply = self._channel.exchange(wire.ArmDevice(), moves=True)
        if not reply.ok:
            raise _rejection(wire.ArmDevice(), reply.reason)
        if reply.fields != (hello.channel_hash,):
            self.stop()
            raise ProtocolError(
                f"{self.address} has channel map hash {''.join(reply.fields) or 'none'}, but its "
                f"hello had {hello.channel_hash}; channels cannot be assigned; open it again"
            )
        self._armed = True

    def _start_stream(self, rate_Hz: float) -> None:
        self._send_command(wire.SetRate(rate_Hz))
        self._rate_Hz = rate_Hz
        self._silent_since_s = None

    def _check_silence(self) -> None:
        now_s = self._clock()
        if self._silent_since_s is None:
            self._silent_since_s = now_s
        silent_s = now_s - self._silent_since_s
        if self._rate_Hz > 0.0 and silent_s > max(STALE_TIMEOUT_S, 3.0 / self._rate_Hz):
            raise LinkLost(
                f"{self.address} sent nothing for {silent_s:.1f} s, limit {STALE_TIMEOUT_S:g} s; "
                f"the device should stop its motors by its watchdog; check cable and power, then "
                f"start again"
            )

    def _process_events(self) -> None:
        """Process the device's events: a stop, the state of the plate, messages."""
        for event in self._channel.take_events():
            self._messages.append(f"{event.kind}: {event.text}")
            if event.stops_motors:
                self._stopped = f"{event.kind}: {event.text}"
            elif event.kind == "arrived":
                self._arrived = True
            elif event.kind == "stage":
                self._stage_fault = event.text

    def _raise_if_stopped(self) -> None:
        if self._stopped is not None:
            self._is_stop_reported = True
            raise DeviceStopped(
                f"the device stopped its motors ({self._stopped}); remove the cause and start again"
            )

    def _receive_readings(self, readings: Readings) -> None:
        """Buffer samples for the next read, with the messages received before them."""
        if len(readings):
            self._process_events()
            if self._messages:
                messages, self._messages = tuple(self._messages), []
                readings = replace(readings, messages=messages)
        self._buffer_readings(readings)


def _rejection(command: wire.Command, reason: str) -> CommandRefused:
    suffix = (
        "; the link delivered it late; check the link and start again"
        if wire.is_too_old(reason)
        else ""
    )
    return CommandRefused(",".join(wire.command_fields(command)), f"{reason}{suffix}")


def open_serial(address: SerialAddress | TcpAddress) -> SerialBench:
    """Return the bench of a serial or TCP port, not opened yet."""
    return SerialBench(build_transport(address), address.text)
