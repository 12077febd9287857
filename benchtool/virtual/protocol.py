"""Bench protocol of a virtual device: bytes in, bytes out, around a `Firmware`; no clock."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from benchtool.bench.serial import commands as wire
from benchtool.bench.serial import frames
from benchtool.bench.serial.hello import hello_lines
from benchtool.core.errors import BenchtoolError
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.links import event_line
from benchtool.virtual.server import ServedDevice

MAX_NUMBER = frames.TIME_MODULUS_US - 1  # largest command number


class OrderCheck:
    """Check for late commands, by number and by age in device time."""

    def __init__(self, speed: float = 1.0) -> None:
        self.armed = False
        self.number = 0  # of the last executed command
        self._speed = speed
        self._stopped_us = -inf

    def stop(self, now_us: int) -> None:
        """Record a stop; commands issued before it are rejected from now on."""
        self.armed = False
        self._stopped_us = now_us

    def refusal(self, number: int, time: str, now_us: int) -> str:
        """Return the reason to reject a late command, "" if it may be executed."""
        if number <= self.number:
            return f"{wire.LATE_REASON}number {number} comes after {self.number}"
        if not (time.isdecimal() and len(time) <= 10 and int(time) < frames.TIME_MODULUS_US):
            return f"{time!r} is no device time; repeat that of the last sample or answer"
        age_us = (now_us - int(time)) % frames.TIME_MODULUS_US
        age_s = age_us / 1e6 / self._speed
        if age_s > wire.MAX_COMMAND_AGE_S:
            limit_ms = 1000.0 * wire.MAX_COMMAND_AGE_S
            return f"{wire.LATE_REASON}{1000.0 * age_s:.0f} ms old; limit {limit_ms:.0f} ms"
        if now_us - age_us < self._stopped_us:
            return f"{wire.LATE_REASON}given before the last stop"
        return ""


class DeviceLink(ServedDevice):
    """Bench protocol handler of one device."""

    def __init__(self, firmware: Firmware) -> None:
        super().__init__(firmware)
        self.orders = OrderCheck(firmware.hello.speed)
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
        if number == self.orders.number and self._answered:
            return self._answered
        time = fields[2] if len(fields) > 2 else ""
        if late := self.orders.refusal(number, time, self.firmware.device_time_us):
            return self._refuse(number, late)
        self.orders.number = number
        # Only an armed device turns motors or moves the plate.
        moves = isinstance(command, wire.SendPlate)
        if isinstance(command, wire.SetPwm):
            moves = any(us > self.firmware.hello.pwm_stop_us for us in command.pwm_us)
        if moves and not self.orders.armed:
            self._answered = self._refuse(number, "not armed since the last stop; send arm first")
        else:
            self._answered = self._execute(number, command, now_s)
        return self._answered

    def _execute(self, number: int, command: wire.Command, now_s: float) -> bytes:
        try:
            reply = self.firmware.execute(command, now_s)
        except BenchtoolError as error:
            reply = wire.Reply(False, str(error))
        if not reply.ok:
            return self._refuse(number, reply.reason)
        if isinstance(command, wire.StopDevice | wire.Clear):
            self.orders.stop(self.firmware.device_time_us)
        self.orders.armed |= isinstance(command, wire.ArmDevice)
        return self._acknowledge(number, reply.fields)

    def _greet(self, number: int, version: int, now_s: float) -> bytes:
        """Return the hello lines, their count and the CRC over them."""
        if version < wire.PROTOCOL_VERSION:
            reason = (
                f"this device speaks protocol version {wire.PROTOCOL_VERSION}; update benchtool"
            )
            return self._refuse(number, reason)
        self.firmware.execute(wire.RequestHello(), now_s)
        self.orders.stop(self.firmware.device_time_us)
        self.orders.number = number
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
