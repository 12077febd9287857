r"""The bench protocol's bytes: text lines with a checksum, to messages and back. Pure.

A line is ``$<payload>*<CRC>\n``; the CRC-16/CCITT-FALSE of the payload is four hexadecimal digits.
The payload's first letter says what it is; `docs/reference/bench-protocol.md` has the whole table.
"""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.serial.commands import AskHello, Command, fields_of
from benchtool.bench.serial.sample_order import SEQUENCE_MODULUS, TIME_MODULUS_US, SampleOrder

Array = NDArray[np.float64]

CRC_START = 0xFFFF
"""Start value of CRC-16/CCITT-FALSE (polynomial 0x1021, no reflection, no final xor)."""

MAX_LINE_BYTES = 512
"""Longest line that a receiver keeps; a longer one is thrown away as a whole."""


def crc16(payload: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE of the payload; of ``123456789`` it is 0x29B1."""
    return crc_hqx(payload, CRC_START)


def frame(payload: bytes) -> bytes:
    """Wrap a payload as a line ready to send."""
    return b"$%b*%04X\n" % (payload, crc16(payload))


def payload_of(letter: str, fields: Iterable[str]) -> bytes:
    """Return text fields as a payload; what would break the line becomes a blank."""
    text = ",".join((letter, *fields))
    return text.translate(_UNSAFE).encode("ascii", "replace")


def frame_fields(letter: str, fields: Iterable[str]) -> bytes:
    """Wrap text fields as a line."""
    return frame(payload_of(letter, fields))


_UNSAFE = str.maketrans({"$": " ", "*": " ", "\n": " ", "\r": " "})

HEARTBEAT = frame(b"B")
"""The line that only says that the host lives."""


def frame_command(number: int, command: Command, time_us: int = 0) -> bytes:
    """Wrap a command with its number and the last device time that the host has read."""
    name, *arguments = fields_of(command)
    time = () if isinstance(command, AskHello) else (str(time_us % TIME_MODULUS_US),)
    return frame_fields("C", (str(number), name, *time, *arguments))


def frame_version_1(number: int, command: Command) -> bytes:
    """Wrap a command for a device of version 1; its numbers run from 1 to 65535."""
    return frame_fields("C", (str(number), *fields_of(command)))


@dataclass(frozen=True, slots=True)
class Message:
    """Hold one line that is no sample: its letter and its text fields."""

    letter: str
    fields: tuple[str, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """Hold what one chunk of bytes completed.

    Attributes:
        device_time_us: (m,) unwrapped over the decoder's life.
        values: (m, c), nan where a field was empty.
        messages: every other line, in order.
        lost: samples missing by their sequence numbers.
        corrupt: lines thrown away.
        repeated: samples left out because they came twice or too late to be sorted.
    """

    device_time_us: NDArray[np.int64]
    values: Array
    messages: tuple[Message, ...]
    lost: int
    corrupt: int
    repeated: int = 0


class Decoder:
    """Turn bytes, in chunks of any size, into samples and messages.

    Garbage never raises. A line counts as corrupt when it holds no valid frame, except before the
    first valid frame, where a link begins in the middle of a line or a board prints its boot text.
    A corrupt sample therefore counts twice: once as corrupt, once as lost.

    Args:
        n_channels: how many values a sample has; None skips samples, as before the hello.
    """

    def __init__(self, n_channels: int | None = None) -> None:
        self._n_channels = n_channels
        self._rest = b""
        self._overlong = False
        self._synchronised = False
        self._order = SampleOrder()

    def expect(self, n_channels: int) -> None:
        """Take samples of so many values from now on, with a fresh count."""
        self._n_channels = n_channels
        self._order = SampleOrder()

    def feed(self, data: bytes) -> Batch:
        """Decode what `data` completes."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if self._overlong and lines:
            lines[0] = b"?" * (MAX_LINE_BYTES + 1)
            self._overlong = False
        if len(self._rest) > MAX_LINE_BYTES:
            self._overlong = True
        if self._overlong:
            self._rest = b""
        samples: list[bytes] = []
        messages: list[Message] = []
        corrupt = 0
        for line in lines:
            payloads: list[bytes] = []
            # The common case first: one whole frame and nothing else.
            if line[:1] == b"$" and line[-5:-4] == b"*" and len(line) <= MAX_LINE_BYTES:
                payload = line[1:-5]
                try:
                    if crc_hqx(payload, CRC_START) == int(line[-4:], 16):
                        payloads = [payload]
                except ValueError:
                    pass
            if not payloads:
                payloads = _search(line)
            if not payloads:
                corrupt += self._synchronised and bool(line.strip())
                continue
            self._synchronised = True
            for payload in payloads:
                if payload[:2] == b"S,":
                    samples.append(payload[2:])
                elif payload:
                    letter, *fields = payload.decode("ascii", "replace").split(",")
                    messages.append(Message(letter, tuple(fields)))
        return self._batch(samples, messages, corrupt)

    def _batch(self, samples: list[bytes], messages: list[Message], corrupt: int) -> Batch:
        if self._n_channels is None or not samples:
            empty = np.empty((0, self._n_channels or 0))
            return Batch(np.empty(0, np.int64), empty, tuple(messages), 0, corrupt)
        width = self._n_channels + 2
        table = _table(samples, width)
        if table is None:
            rows = [row for one in samples if (row := _table([one], width)) is not None]
            corrupt += len(samples) - len(rows)
            table = np.concatenate(rows) if rows else np.empty((0, width))
        found = self._order.sort(table[:, :2].astype(np.int64))
        values = table[found.rows, 2:]
        return Batch(found.time_us, values, tuple(messages), found.lost, corrupt, found.repeated)


def _search(line: bytes) -> list[bytes]:
    """Return the payloads of all valid frames in a line that is not simply one frame."""
    if len(line) > MAX_LINE_BYTES:
        return []
    found = []
    for piece in line.removesuffix(b"\r").split(b"$")[1:]:
        payload, star, digits = piece.rpartition(b"*")
        if star and len(digits) == 4:
            try:
                if crc_hqx(payload, CRC_START) == int(digits, 16):
                    found.append(payload)
            except ValueError:
                continue
    return found


def _table(samples: Sequence[bytes], width: int) -> Array | None:
    """Return samples (m, width) as numbers, or None when one of them does not fit."""
    commas = width - 1
    for sample in samples:
        if sample.count(b",") != commas:
            return None
    text = b",".join(samples) + b","
    text = text.replace(b",,", b",nan,").replace(b",,", b",nan,")
    try:
        numbers = np.fromstring(text[:-1], dtype=float, sep=",")
    except (ValueError, DeprecationWarning):
        return None
    if numbers.size != width * len(samples):
        return None
    table: Array = numbers.reshape(-1, width)
    head = table[:, :2]
    # Nan fails the comparison, so that an empty number or time is refused as well.
    if not np.all((head >= 0) & (head < (SEQUENCE_MODULUS, TIME_MODULUS_US))):
        return None
    return table


@dataclass(slots=True)
class SampleWriter:
    """Format samples of `n_channels` values as a device does with printf, and number them."""

    n_channels: int
    sequence: int = 0

    def frames(self, device_time_us: NDArray[np.int64], values: Array) -> list[bytes]:
        """Return one line per row of values (m, c) at device times (m,): us; nan becomes empty."""
        form = "S,%d,%d" + ",%.7g" * self.n_channels
        lines = []
        for time_us, row in zip(device_time_us.tolist(), values.tolist(), strict=True):
            text = form % (self.sequence, time_us % TIME_MODULUS_US, *row)
            lines.append(frame(text.replace("nan", "").encode("ascii")))
            self.sequence = (self.sequence + 1) % SEQUENCE_MODULUS
        return lines
