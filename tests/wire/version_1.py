"""A device of protocol version 1, as they are in the field: what version 2 must still drive."""

from __future__ import annotations

from benchtool.bench.serial.commands import Reply, RequestHello, command_from
from benchtool.bench.serial.frames import TextMessage, frame_fields
from benchtool.bench.serial.hello import hello_lines
from benchtool.core.errors import BenchtoolError
from benchtool.virtual.firmware import Firmware
from benchtool.virtual.protocol import DeviceLink


class VersionOne(DeviceLink):
    """Carry out any number that is not that of the command before, whatever its age.

    Args:
        refuses: whether it refuses a hello of another version than 1.
    """

    def __init__(self, firmware: Firmware, refuses: bool = False) -> None:
        super().__init__(firmware)
        self._refuses = refuses
        self._last: tuple[int, bytes] | None = None

    def _answer(self, message: TextMessage, now_s: float) -> bytes:
        self.firmware.note_host(now_s)
        if message.letter != "C" or len(message.fields) < 2 or not message.fields[0].isdecimal():
            return b""
        number, name, *values = message.fields
        if not 0 < int(number) < 65536:
            return b""  # as the firmware for the Arduino did
        if name != "hello" and self._last is not None and self._last[0] == int(number):
            return self._last[1]
        answer = self._carried_out(number, (name, *values), now_s)
        self._last = int(number), answer
        return answer

    def _carried_out(self, number: str, fields: tuple[str, ...], now_s: float) -> bytes:
        if self._refuses and fields[0] == "hello" and fields[1] != "1":
            return frame_fields("N", (number, "this device speaks version 1"))
        try:
            command = command_from(fields)
            reply = self.firmware.execute(command, now_s)
        except BenchtoolError as error:
            reply = Reply(False, str(error))
        else:
            if isinstance(command, RequestHello):
                self.host_since_s = now_s
                _, *others = hello_lines(self.firmware.hello)
                lines = [("protocol", "1"), *others]
                told = b"".join(frame_fields("H", line) for line in lines)
                return told + frame_fields("A", (number, self._time(), str(len(lines))))
        if not reply.ok:
            return frame_fields("N", (number, reply.reason))
        return frame_fields("A", (number, self._time(), *reply.fields))
