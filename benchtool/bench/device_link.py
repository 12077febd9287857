"""The device's end of the wire: bytes in, bytes out, around a `Firmware`. Pure; time is handed in.

This is what a microcontroller does in its loop: read lines, answer each command number once, send
samples and events.
"""

from __future__ import annotations

from benchtool.bench.commands import AskHello, Reply, command_from
from benchtool.bench.firmware import Event, Firmware
from benchtool.bench.hello import hello_lines
from benchtool.bench.link import TIME_MODULUS_US, Decoder, Message, SampleWriter, frame_fields
from benchtool.errors import BenchtoolError


class DeviceLink:
    """Speak the bench protocol for one device.

    Attributes:
        firmware: the device itself.
        greeted_s: wall time of the last hello, None before the first.
    """

    def __init__(self, firmware: Firmware) -> None:
        self.firmware = firmware
        self.greeted_s: float | None = None
        self._decoder = Decoder()
        self._writer = SampleWriter(len(firmware.hello.channels))
        self._answered: tuple[int, bytes] | None = None

    @property
    def speed(self) -> float:
        """Device seconds per wall second."""
        return self.firmware.hello.speed

    def receive(self, data: bytes, now_s: float) -> bytes:
        """Take what arrived at wall time `now_s` and return the answers."""
        if not data:
            return b""
        return b"".join(
            self._answer(message, now_s) for message in self._decoder.feed(data).messages
        )

    def tick(self, n: int, now_s: float) -> tuple[bytes, list[bytes]]:
        """Run n ticks; return what must get through, and one line per sample of the stream."""
        rows = self.firmware.advance(n, now_s)
        events = b"".join(event_line(event) for event in self.firmware.take_events())
        if self.firmware.rate_Hz <= 0.0:
            return events, []
        return events, self._writer.frames(rows.device_time_us, rows.values)

    def tell_dropped(self, count: int) -> bytes:
        """Return the event that says how many samples were dropped."""
        text = f"{count} samples dropped by the device since the hello; read faster"
        return event_line(Event("dropped", text))

    def _answer(self, message: Message, now_s: float) -> bytes:
        self.firmware.hear(now_s)
        if message.letter != "C" or len(message.fields) < 2 or not message.fields[0].isdecimal():
            return b""
        number, name = int(message.fields[0]), message.fields[1]
        if name == "hello":
            self._answered = None
        if self._answered is not None and self._answered[0] == number:
            return self._answered[1]
        answer = self._execute(number, message.fields[1:], now_s)
        self._answered = (number, answer)
        return answer

    def _execute(self, number: int, fields: tuple[str, ...], now_s: float) -> bytes:
        try:
            command = command_from(fields)
            reply = self.firmware.execute(command, now_s)
        except BenchtoolError as error:
            reply = Reply(False, str(error))
        else:
            if isinstance(command, AskHello):
                self.greeted_s = now_s
                lines = hello_lines(self.firmware.hello)
                told = b"".join(frame_fields("H", map(_one_field, line)) for line in lines)
                return told + self._acknowledge(number, (str(len(lines)),))
        if not reply.ok:
            return frame_fields("N", (str(number), reply.reason))
        return self._acknowledge(number, reply.fields)

    def _acknowledge(self, number: int, fields: tuple[str, ...]) -> bytes:
        time_us = self.firmware.device_time_us % TIME_MODULUS_US
        return frame_fields("A", (str(number), str(time_us), *fields))


def event_line(event: Event) -> bytes:
    """Return the line that reports an event."""
    return frame_fields("E", (event.kind, event.text))


def _one_field(text: str) -> str:
    return text.replace(",", ";")
