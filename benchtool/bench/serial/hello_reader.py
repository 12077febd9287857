"""The host's end of the hello: lines that got lost, doubled, exchanged or damaged are noticed."""

from __future__ import annotations

from collections.abc import Sequence

from benchtool.bench.serial.hello import Hello, hello_from
from benchtool.bench.serial.link import crc16, payload_of

MOST_LINES = 256
"""More are not stored; a bench with 64 rotors says about 220."""

Line = tuple[str, ...]


class HelloReader:
    """Put a hello together from its lines.

    In version 2 each line has its index, and the answer the count and a CRC over all lines: what
    was lost may come with a later try. Version 1 has a count only, so that its channels are in
    order by the order of arrival; two whole answers must be the same.
    """

    def __init__(self) -> None:
        self._indexed: dict[int, Line] = {}
        self._listed: list[Line] = []
        self._before: list[Line] | None = None

    def begin(self) -> None:
        """Begin another try."""
        self._listed = []

    def take(self, line: Line) -> None:
        """Take the fields of one line."""
        if line and line[0].isdecimal():
            if int(line[0]) < MOST_LINES and len(line) > 1:
                self._indexed[int(line[0])] = line
        elif line and len(self._listed) <= MOST_LINES:
            self._listed.append(line)

    def hello(self, answer: Sequence[str]) -> Hello | None:
        """Return the hello when it is whole, None when it must be asked for again.

        Args:
            answer: what the answer carries beyond the device time.

        Raises:
            ProtocolError: it is whole, and it makes no sense.
        """
        if len(answer) >= 2:
            return self._checked(answer[0], answer[1])
        whole = list(answer) == [str(len(self._listed))]
        if whole and self._listed == self._before:
            return hello_from(self._listed)
        if whole:
            self._before = self._listed
        return None

    def _checked(self, count: str, whole: str) -> Hello | None:
        lines = [line for _, line in sorted(self._indexed.items())]
        if count != str(len(lines)):
            return None
        said = crc16(b"".join(payload_of("H", line) + b"\n" for line in lines))
        if whole != f"{said:04X}":
            self._indexed.clear()
            return None
        return hello_from(line[1:] for line in lines)
