"""A bench behind the wire: `serial:` and `tcp:` addresses.

Heartbeats are sent by `read` and by commands only, never by a thread of their own: a host whose
control loop hangs must fall silent, so that the device stops its motors. Whoever spins motors
therefore reads at least every `identity.watchdog_s`.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from benchtool.bench.addresses import SerialAddress, TcpAddress
from benchtool.bench.bench import DeviceInfo, Readings, StreamingBench
from benchtool.bench.serial import commands as wire
from benchtool.bench.serial.command_channel import CommandChannel
from benchtool.bench.serial.hello import Hello, check_rate, max_rate_Hz
from benchtool.bench.transport.sockets import TcpSocket
from benchtool.bench.transport.transport import Transport
from benchtool.core.array_type import Array
from benchtool.core.errors import (
    BenchError,
    CommandRefused,
    DeviceStopped,
    LinkLost,
    NoDevice,
    ProtocolError,
    StageError,
)

STALE_TIMEOUT_S = 1.0  # wall time without data after which a stream is lost: 4 watchdogs; assumed
PLATE_POLL_INTERVAL_S = (
    0.5  # interval of state requests while the plate moves: `arrived` may be lost
)

STOP_ATTEMPTS = 3


class SerialBench(StreamingBench):
    """Drive a device that speaks the bench protocol.

    Time of this bench is wall time, multiplied by the speed that a virtual device gives in its
    hello; every `timeout_s` is in that time. Link time-outs and the watchdog are wall time.

    Args:
        arrive_s: bench time after which a plate that has not arrived is given up.
        device_id: the only device to accept, as after a replug or for a resumed run; None takes
            any.
    """

    def __init__(
        self,
        transport: Transport,
        address: str,
        clock: Callable[[], float] = time.monotonic,
        arrive_s: float = 120.0,
        device_id: str | None = None,
    ) -> None:
        super().__init__(address)
        self._conversation = CommandChannel(transport, address, clock, self._take_in)
        self._clock = clock
        self._arrive_s = arrive_s
        self._device_id = device_id
        self._hello: Hello | None = None
        self._rate_Hz = 0.0
        self._messages: list[str] = []
        self._silent_since_s: float | None = None
        self._stopped: str | None = None
        self._reported = False
        self._armed = False
        self._arrived = False
        self._stage_fault: str | None = None

    @property
    def identity(self) -> DeviceInfo:
        return self._known().identity(self.address, self._rate_Hz)

    def now_s(self) -> float:
        return self._conversation.now_s()

    def open(self) -> None:
        if self._hello is not None:
            return
        self._clear_buffer()
        try:
            self._hello = self._conversation.open()
            if self._device_id not in (None, self._hello.device_id):
                raise NoDevice(
                    f"{self.address} answers as device {self._hello.device_id!r}, but "
                    f"{self._device_id!r} is needed; plug that one in or start a new run"
                )
            self.clear()
            self._messages.clear()
            fits_Hz = self._hello.rate_Hz
            if baud := self._baud():
                most_Hz = max_rate_Hz(self._hello.frame_bytes, baud)
                fits_Hz = min(fits_Hz, most_Hz / self._hello.speed)
            self._start_stream(fits_Hz)
        except BaseException:
            self._conversation.close()
            self._hello = None
            raise

    def close(self) -> None:
        if self._hello is None:
            return
        try:
            self._conversation.exchange(wire.StopDevice(), STOP_ATTEMPTS)
            self._conversation.exchange(wire.SetRate(0.0), STOP_ATTEMPTS)
        except BenchError:
            pass  # The device's watchdog stops the motors where we cannot.
        finally:
            self._conversation.close()
            self._hello = None

    def set_pwm(self, pwm_us: Array) -> None:
        self._raise_if_stopped()
        pulses = np.asarray(pwm_us, float).ravel()
        turns = bool((pulses > self._known().pwm_stop_us).any())
        if turns:
            self._arm()
        try:
            self._order(wire.SetPwm(tuple(pulses.tolist())), turns)
        except CommandRefused:
            self._armed = False  # Perhaps by a stop from another thread; the next order arms anew.
            raise

    def stop(self) -> None:
        self._armed = False
        self._order(wire.StopDevice())

    def halt(self) -> None:
        """Send zero at once, from any thread (`SupportsEmergencyStop`)."""
        self._conversation.halt()

    def move_plate(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        self._raise_if_stopped()
        self._arm()
        self._arrived, self._stage_fault = False, None
        reply = self._conversation.exchange(wire.SendPlate(z_m, x_m, tilt_rad), moves=True)
        if not reply.ok:
            self._armed = False
            if reply.reason.startswith(wire.LATE_REASON):  # No fault of the stage.
                raise _refused(wire.SendPlate(z_m, x_m, tilt_rad), reply.reason)
            raise StageError(f"the stage refused to move to {z_m:g} m: {reply.reason}")
        started_s = requested_s = self._clock()
        while not self._arrived:
            self._conversation.pump(0.05)
            self._note()
            self._raise_if_stopped()
            if self._stage_fault is not None:
                raise StageError(f"the stage did not reach {z_m:g} m: {self._stage_fault}")
            now_s = self._clock()
            if (now_s - started_s) * self._known().speed > self._arrive_s:
                self.stop()
                raise StageError(
                    f"the plate did not reach {z_m:g} m within {self._arrive_s:g} s and was "
                    f"halted; look for what blocks it"
                )
            if now_s - requested_s > PLATE_POLL_INTERVAL_S and not self._arrived:
                requested_s = now_s
                moving = self._conversation.exchange(wire.RequestPlate()).fields
                if moving[:1] == ("0",):
                    self._arrived = True

    def tare(self) -> None:
        self._order(wire.TareDevice())

    def set_limit(self, name: str, value: float) -> None:
        """Make one device-side limit narrower; the device refuses a wider one."""
        self._order(wire.SetLimit(name, value))

    def clear(self) -> None:
        """Lift the latch of a device that stopped by itself; its motors stay at zero."""
        self._armed = False
        self._order(wire.Clear())
        self._note()
        self._stopped, self._reported = None, False

    def set_rate(self, rate_Hz: float) -> None:
        hello = self._known()
        check_rate(rate_Hz * hello.speed, hello.frame_bytes, self._baud())
        self._start_stream(rate_Hz)

    def read(self, timeout_s: float) -> Readings:
        speed = self._known().speed
        deadline_s = self._clock() + timeout_s / speed
        while True:
            self._note()
            # Before the samples, which later reads return: some of them may already show motors
            # that stand under the pulse that the host commanded last.
            if not self._reported:
                self._raise_if_stopped()
            if (waiting := self._take_buffered()) is not None:
                self._silent_since_s = None
                return waiting
            left_s = deadline_s - self._clock()
            if left_s <= 0.0:
                return self._take_buffered_or_read(self._no_samples)
            if not self._conversation.pump(left_s):
                self._check_silence()

    def _known(self) -> Hello:
        if self._hello is None:
            raise LinkLost(f"{self.address} is not open; open it first")
        return self._hello

    def _baud(self) -> int:
        """Return the rate of the slower end's line, 0 where there is no such limit."""
        device_baud = self._known().baud
        opened = self._conversation.transport.baud
        return min(device_baud, opened) if device_baud and opened else device_baud

    def _order(self, command: wire.Command, moves: bool = False) -> None:
        self._known()
        reply = self._conversation.exchange(command, moves=moves)
        if not reply.ok:
            raise _refused(command, reply.reason)

    def _arm(self) -> None:
        """Arm a device that was stopped since; refuse one with other channels than its hello's."""
        hello = self._known()
        if self._armed:
            return
        reply = self._conversation.exchange(wire.ArmDevice(), moves=True)
        if not reply.ok:
            raise _refused(wire.ArmDevice(), reply.reason)
        if reply.fields != (hello.channel_hash,):
            self.stop()
            raise ProtocolError(
                f"{self.address} has a channel map of hash {''.join(reply.fields) or 'none'}, at "
                f"its hello {hello.channel_hash}; its channels cannot be assigned; open it anew"
            )
        self._armed = True

    def _start_stream(self, rate_Hz: float) -> None:
        self._order(wire.SetRate(rate_Hz))
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
                "the "
                f"device should stop its motors by its watchdog; check cable and power, then start "
                f"again"
            )

    def _note(self) -> None:
        """Take the device's events: what stopped it, where the plate is, what it says."""
        for event in self._conversation.take_events():
            self._messages.append(f"{event.kind}: {event.text}")
            if event.stops_motors:
                self._stopped = f"{event.kind}: {event.text}"
            elif event.kind == "arrived":
                self._arrived = True
            elif event.kind == "stage":
                self._stage_fault = event.text

    def _raise_if_stopped(self) -> None:
        if self._stopped is not None:
            self._reported = True
            raise DeviceStopped(
                f"the device stopped its motors by itself ({self._stopped}); remove the cause and "
                f"start again"
            )

    def _take_in(self, readings: Readings) -> None:
        """Hold samples for the next read, with the messages that came before them."""
        if len(readings):
            self._note()
            messages, self._messages = tuple(self._messages), []
            readings = replace(readings, messages=messages)
        self._buffer_readings(readings)

    def _no_samples(self) -> Readings:
        messages, self._messages = tuple(self._messages), []
        none = np.empty(0)
        return Readings(none, none, np.empty((0, len(self._known().channels))), messages=messages)


def _refused(command: wire.Command, reason: str) -> CommandRefused:
    late = (
        "; the link delivered it late; check the link and start again"
        if wire.is_too_old(reason)
        else ""
    )
    return CommandRefused(",".join(wire.command_fields(command)), f"{reason}{late}")


def open_serial(address: SerialAddress) -> SerialBench:
    """Return the bench on a serial port, not opened yet."""
    from benchtool.bench.transport.serial_port import SerialPort

    return SerialBench(SerialPort(address.port, address.baud), address.text)


def open_tcp(address: TcpAddress) -> SerialBench:
    """Return the bench behind a TCP port, not opened yet."""
    return SerialBench(TcpSocket(address.host, address.port), address.text)
