"""Server of a virtual device on a link, and the bench protocol of a device without a port."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from math import inf

from benchtool.bench.serial import commands as wire
from benchtool.bench.serial import frames
from benchtool.bench.serial.hello import hello_lines
from benchtool.core.errors import BenchtoolError
from benchtool.virtual.faults import LinkFaults
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.links import ServerLink, event_line

MAX_NUMBER = frames.TIME_MODULUS_US - 1  # largest command number


class ServedDevice(ABC):
    """Device without a port, around a guarded plant; wall time is passed in."""

    def __init__(self, firmware: Firmware) -> None:
        self.firmware, self.speed = firmware, firmware.hello.speed
        self.host_since_s: float | None = None  # wall time of the hello; None before the first

    @abstractmethod
    def receive(self, data: bytes, now_s: float) -> bytes:
        """Process received bytes and return the replies."""

    @abstractmethod
    def tick(self, n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        """Run n ticks; return bytes that must be sent, and frames that may be dropped."""

    @abstractmethod
    def report(self, kind: str, text: str) -> bytes:
        """Return an event for the host."""


class DeviceLink(ServedDevice):
    """Bench protocol handler of one device."""

    def __init__(self, firmware: Firmware) -> None:
        super().__init__(firmware)
        self._armed = False
        self._number = 0  # of the last executed command
        self._stopped_us = -inf
        self._decoder = frames.Decoder()
        self._writer = frames.SampleFramer(len(firmware.hello.channels))
        self._answered = b""

    def receive(self, data: bytes, now_s: float) -> bytes:
        if not data:
            return b""
        self._decoder.feed(data)
        return b"".join(self._answer(line, now_s) for line in self._decoder.take_messages())

    def tick(self, n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        rows = self.firmware.advance(n, now_s)
        events = b"".join(event_line(event) for event in self.firmware.take_events())
        if self.firmware.rate_Hz <= 0.0:
            return events, []
        return events, self._writer.frames(rows.device_time_us, rows.values)

    def report(self, kind: str, text: str) -> bytes:
        return event_line(wire.DeviceEvent(kind, text))

    def _answer(self, message: frames.TextMessage, now_s: float) -> bytes:
        self.firmware.note_host(now_s)
        fields = message.fields
        if message.letter != "C" or len(fields) < 2 or not fields[0].isdecimal():
            return b""
        number, name = int(fields[0]), fields[1]
        if number > MAX_NUMBER:
            return b""
        try:
            # A hello carries its version in the place of the time.
            command = wire.decode_command((name, *fields[2 if name == "hello" else 3 :]))
        except BenchtoolError as error:
            return self._refuse(number, str(error))
        match command:
            case wire.RequestHello(version):
                return self._greet(number, version, now_s)
            case wire.StopDevice() | wire.RequestPlate():
                return self._execute(number, command, now_s)
        if number == self._number and self._answered:
            return self._answered
        time = fields[2] if len(fields) > 2 else ""
        if late := self._late_reason(number, time):
            return self._refuse(number, late)
        self._number = number
        # Only an armed device turns motors or moves the plate.
        moves = isinstance(command, wire.SendPlate)
        if isinstance(command, wire.SetPwm):
            moves = any(us > self.firmware.hello.pwm_stop_us for us in command.pwm_us)
        if moves and not self._armed:
            self._answered = self._refuse(number, "not armed since the last stop; send arm first")
        else:
            self._answered = self._execute(number, command, now_s)
        return self._answered

    def _late_reason(self, number: int, time: str) -> str:
        """Return the reason to reject a late command, "" if it may be executed."""
        now_us = self.firmware.device_time_us
        if number <= self._number:
            return f"{wire.LATE_REASON}number {number} comes after {self._number}"
        if not (time.isdecimal() and len(time) <= 10 and int(time) < frames.TIME_MODULUS_US):
            return f"{time!r} is no device time; repeat that of the last sample or answer"
        age_us = (now_us - int(time)) % frames.TIME_MODULUS_US
        age_s = age_us / 1e6 / self.speed
        if age_s > wire.MAX_COMMAND_AGE_S:
            limit_ms = 1000.0 * wire.MAX_COMMAND_AGE_S
            return f"{wire.LATE_REASON}{1000.0 * age_s:.0f} ms old; limit {limit_ms:.0f} ms"
        if now_us - age_us < self._stopped_us:
            return f"{wire.LATE_REASON}given before the last stop"
        return ""

    def _note_stop(self) -> None:
        """Record a stop; commands issued before it are rejected from now on."""
        self._armed, self._stopped_us = False, self.firmware.device_time_us

    def _execute(self, number: int, command: wire.Command, now_s: float) -> bytes:
        try:
            reply = self.firmware.execute(command, now_s)
        except BenchtoolError as error:
            reply = wire.Reply(False, str(error))
        if not reply.ok:
            return self._refuse(number, reply.reason)
        if isinstance(command, wire.StopDevice | wire.Clear):
            self._note_stop()
        self._armed |= isinstance(command, wire.ArmDevice)
        return self._acknowledge(number, reply.fields)

    def _greet(self, number: int, version: int, now_s: float) -> bytes:
        """Return the hello lines, their count and the CRC over them."""
        if version < wire.PROTOCOL_VERSION:
            reason = (
                f"this device speaks protocol version {wire.PROTOCOL_VERSION}; update benchtool"
            )
            return self._refuse(number, reason)
        self.firmware.execute(wire.RequestHello(), now_s)
        self._note_stop()
        self._number = number
        self._answered = b""
        self.host_since_s = now_s
        payloads = [
            frames.build_payload("H", (str(index), *(text.replace(",", ";") for text in line)))
            for index, line in enumerate(hello_lines(self.firmware.hello))
        ]
        whole = frames.crc16(b"".join(payload + b"\n" for payload in payloads))
        answer = self._acknowledge(number, (str(len(payloads)), f"{whole:04X}"))
        return b"".join(map(frames.frame, payloads)) + answer

    def _acknowledge(self, number: int, fields: Sequence[str]) -> bytes:
        return frames.frame_fields("A", (str(number), self._time(), *fields))

    def _refuse(self, number: int, reason: str) -> bytes:
        return frames.frame_fields("N", (str(number), self._time(), reason))

    def _time(self) -> str:
        return str(self.firmware.device_time_us % frames.TIME_MODULUS_US)


POLL_INTERVAL_S = 0.004
MAX_CATCH_UP_S = 0.5  # maximum wall time that the physics catches up with
FAILURE_REPORT_S = 1.0  # duration of the report of a failure; assumed
OUTBOX_BYTES = 65536  # buffer on top of the link's; 0.6 s of 12 channels at 1 kHz; assumed


class ServerOutbox:
    """Send buffer: replies are always added, samples only while there is room."""

    def __init__(self, room_bytes: int = OUTBOX_BYTES) -> None:
        self.dropped = 0
        self._room_bytes = room_bytes
        self._waiting = bytearray()

    def add(self, data: bytes) -> None:
        self._waiting += data

    def add_sample(self, line: bytes) -> None:
        """Add a sample, or drop and count it if there is no room."""
        if len(self._waiting) + len(line) > self._room_bytes:
            self.dropped += 1
        else:
            self._waiting += line

    def flush(self, write: Callable[[bytes], int]) -> None:
        """Write as many bytes as `write` accepts."""
        if self._waiting:
            del self._waiting[: write(bytes(self._waiting))]

    def clear(self) -> None:
        self._waiting.clear()


class BenchServer:
    """Server of one device on one link, for one host at a time."""

    def __init__(
        self,
        device: ServedDevice,
        link: ServerLink,
        tick_Hz: Callable[[], float],  # current ticks per second of device time
        faults: LinkFaults | None = None,
        on_hello: Callable[[], None] = lambda: None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.outbox = ServerOutbox()
        self._device = device
        self._link = link
        self._tick_Hz = tick_Hz
        self._faults = faults or LinkFaults()
        self._on_hello = on_hello
        self._clock = clock
        self._dropped_before = 0
        self._report_from = 1
        self._stalled_s, self._reported_stall_s = 0.0, 0.0
        self._owed = 0.0
        self._last_s = clock()
        self._host_since_s: float | None = None

    def run(
        self, running: Callable[[], bool] = lambda: True, interval_s: float = POLL_INTERVAL_S
    ) -> None:
        """Serve until `running` returns False; report an error of the device, then raise it."""
        while running():
            try:
                self.step()
            except BenchtoolError:
                until_s = self._clock() + FAILURE_REPORT_S
                while self._clock() < until_s:
                    self.step()
                    time.sleep(interval_s)
                raise
            time.sleep(interval_s)

    def step(self) -> None:
        """Read, advance the plant by the elapsed time, and write."""
        now_s = self._clock()
        answers = self._device.receive(self._link.read(), now_s)
        self._greet()
        since_s = 0.0 if self._host_since_s is None else now_s - self._host_since_s
        self._plug(since_s)
        self.outbox.add(self._faults.carry(answers, since_s))
        elapsed_s = min(now_s - self._last_s, MAX_CATCH_UP_S)
        self._stalled_s += now_s - self._last_s - elapsed_s
        self._last_s = now_s
        self._owed += elapsed_s * self._device.speed * self._tick_Hz()
        n, self._owed = int(self._owed), self._owed % 1.0
        # The watchdog is checked even if no tick is due.
        events, samples = self._device.tick(n, now_s)
        self.outbox.add(self._faults.carry(events, since_s))
        for line in samples:
            self.outbox.add_sample(self._faults.carry(line, since_s))
        self._report_problems()
        self.outbox.flush(self._link.write)

    def _greet(self) -> None:
        """Reset the problem counters if the host has sent a new hello."""
        if self._device.host_since_s != self._host_since_s:
            self._host_since_s = self._device.host_since_s
            self._dropped_before, self._report_from = self.outbox.dropped, 1
            self._stalled_s, self._reported_stall_s = 0.0, 0.0
            self._on_hello()

    def _plug(self, since_s: float) -> None:
        change = self._faults.plugged(since_s)
        if change is False:
            self.outbox.clear()
            self._link.unplug()
        elif change is True:
            self._host_since_s = None
            self._link.replug()

    def _report_problems(self) -> None:
        """Report at every doubling, so that reports do not fill a link that is already full."""
        if self._host_since_s is None:
            return
        count = self.outbox.dropped - self._dropped_before
        if count >= self._report_from:
            text = f"{count} samples dropped by the device since the hello; read faster"
            self.outbox.add(self._device.report("dropped", text))
            self._report_from = 2 * count
        if self._stalled_s > self._reported_stall_s:
            speed = self._device.speed
            text = (
                f"virtual bench stalled for {self._stalled_s * speed:.1f} s of device time; its "
                f"computer is busy or too slow for --speed {speed:g}"
            )
            self.outbox.add(self._device.report("stood_still", text))
            self._reported_stall_s = 2.0 * self._stalled_s
