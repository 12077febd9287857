r"""The bench protocol's bytes: text lines with a checksum, to messages and back. Pure.

A line is ``$<payload>*<CRC>\n``; the CRC-16/CCITT-FALSE of the payload is four hexadecimal digits.
The payload's first letter says what it is; `docs/reference/bench-protocol.md` has the whole table.
"""

from __future__ import annotations

from binascii import crc_hqx
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.bench.bench import Readings
from benchtool.bench.clocks import DeviceClock
from benchtool.bench.serial.commands import Command, RequestHello, command_fields
from benchtool.core.array_type import Array

CRC_START = 0xFFFF  # CRC-16/CCITT-FALSE (polynomial 0x1021, no reflection, no final xor)
MAX_LINE_BYTES = 512  # Longest line that a receiver buffers; a longer one is discarded as a whole


def crc16(payload: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE of the payload; of ``123456789`` it is 0x29B1."""
    return crc_hqx(payload, CRC_START)


def frame(payload: bytes) -> bytes:
    """Wrap a payload as a line ready to send."""
    return b"$%b*%04X\n" % (payload, crc16(payload))


def parse_frame(letter: str, fields: Iterable[str]) -> bytes:
    """Return text fields as a payload; what would break the line becomes a blank."""
    text = ",".join((letter, *fields))
    return text.translate(_UNSAFE).encode("ascii", "replace")


def frame_fields(letter: str, fields: Iterable[str]) -> bytes:
    """Wrap text fields as a line."""
    return frame(parse_frame(letter, fields))


_UNSAFE = str.maketrans({"$": " ", "*": " ", "\n": " ", "\r": " "})

HEARTBEAT = frame(b"B")  # The line that only says that the host lives


def frame_command(number: int, command: Command, time_us: int = 0) -> bytes:
    """Wrap a command with its number and the last device time that the host has read."""
    name, *arguments = command_fields(command)
    time = () if isinstance(command, RequestHello) else (str(time_us % TIME_MODULUS_US),)
    return frame_fields("C", (str(number), name, *time, *arguments))


class TextMessage(NamedTuple):
    """Hold one line that is no sample: its letter and its text fields."""

    letter: str
    fields: tuple[str, ...]


class Decoder:
    """Turn bytes, in chunks of any size, into readings on the host's clock, and into messages.

    Garbage never raises. A line counts as corrupt when it holds no valid frame, except before the
    first valid frame, where a link begins in the middle of a line or a board prints its boot text.
    A corrupt sample therefore counts twice: once as corrupt, once as lost.

    Args:
        n_channels: how many values a sample has; None skips samples, as before the hello.
    """

    def __init__(self, n_channels: int | None = None) -> None:
        self._rest = b""
        self._overlong = False
        self._synchronised = False
        self._messages: list[TextMessage] = []
        self.expect(n_channels)

    def expect(self, n_channels: int | None, speed: float = 1.0) -> None:
        """Take samples of so many values from now on, with a fresh count and clock."""
        self._n_channels = n_channels
        self._order, self._clock = SampleOrder(), DeviceClock(speed)

    def take_messages(self) -> list[TextMessage]:
        """Return every line since the last call that is no sample, in order."""
        messages, self._messages = self._messages, []
        return messages

    def feed(self, data: bytes, arrived_s: float = 0.0) -> Readings:
        """Decode what `data` completes, which arrived at a time of the bench's clock."""
        *lines, self._rest = (self._rest + data).split(b"\n")
        if self._overlong and lines:
            lines[0] = b"?" * (MAX_LINE_BYTES + 1)
            self._overlong = False
        if len(self._rest) > MAX_LINE_BYTES:
            self._overlong = True
        if self._overlong:
            self._rest = b""
        samples: list[bytes] = []
        corrupt = 0
        for line in lines:
            # The common case first: one whole frame and nothing else.
            if line[:1] == b"$" and line[-5:-4] == b"*" and _is_valid(line[1:-5], line[-4:]):
                payloads = [line[1:-5]]
            else:
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
                    self._messages.append(TextMessage(letter, tuple(fields)))
        if self._n_channels is None or not samples:
            none = np.empty(0)
            return Readings(none, none, np.empty((0, self._n_channels or 0)), corrupt=corrupt)
        width = self._n_channels + 2
        table = _table(samples, width)
        if table is None:
            rows = [row for one in samples if (row := _table([one], width)) is not None]
            corrupt += len(samples) - len(rows)
            table = np.concatenate(rows) if rows else np.empty((0, width))
        found = self._order.sort(table[:, :2].astype(np.int64))
        if len(found.rows):
            self._clock.learn(int(found.time_us[-1]), arrived_s)
        return Readings(
            time_s=self._clock.host_time_s(found.time_us),
            device_time_us=found.time_us.astype(float),
            values=table[found.rows, 2:],
            lost=found.lost,
            corrupt=corrupt,
            repeated=found.repeated,
        )


def split_messages(data: bytes) -> list[TextMessage]:
    """Return the messages in bytes of which nothing is known yet."""
    decoder = Decoder()
    decoder.feed(data)
    return decoder.take_messages()


def _is_valid(payload: bytes, digits: bytes) -> bool:
    try:
        return len(payload) <= MAX_LINE_BYTES - 6 and crc16(payload) == int(digits, 16)
    except ValueError:
        return False


def _search(line: bytes) -> list[bytes]:
    """Return the payloads of all valid frames in a line that is not simply one frame."""
    if len(line) > MAX_LINE_BYTES:
        return []
    pieces = [piece.rpartition(b"*") for piece in line.removesuffix(b"\r").split(b"$")[1:]]
    return [
        payload
        for payload, star, digits in pieces
        if star and len(digits) == 4 and _is_valid(payload, digits)
    ]


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
class SampleFramer:
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


SEQUENCE_MODULUS = 1 << 16
TIME_MODULUS_US = 1 << 32
WINDOW = 64
"""A sample that comes so many places late is out of order; an earlier one is not accepted at once.
A choice: radios and UDP reorder neighbours."""

LEAP = 4096
"""Neither is a sample so many places ahead: its number passed the checksum by chance, or the device
restarted. A choice, 4 s at 1 kHz."""


def signed_step(new: int, old: int, modulus: int) -> int:
    """Return how far a wrapping count went, negative where it went back (RFC 1982)."""
    half = modulus // 2
    return (new - old + half) % modulus - half


class SortedMessages(NamedTuple):
    """Hold which samples of a block are used, in their order.

    Attributes:
        rows: (m,) indices into the block.
        time_us: (m,) their device time, unwrapped.
        lost: samples that are missing before or between them.
        repeated: samples left out because they came twice, or after a later one was handed on.
    """

    rows: NDArray[np.int64]
    time_us: NDArray[np.int64]
    lost: int
    repeated: int


class SampleOrder:
    """Put blocks of samples in order by their numbers and device times.

    Within a block samples are sorted. A gap longer than half of the numbers' range differs from a
    shorter one by the device time that has passed, once two neighbours have shown the period.
    """

    def __init__(self) -> None:
        self._newest: tuple[int, int] | None = None  # number and time as sent
        self._place = 0  # of the newest sample, counted on over all wraps
        self._time_us = 0  # of the newest sample, unwrapped
        self._period_us = 0.0
        self._doubted: tuple[int, int] | None = None

    def sort(self, stamps: NDArray[np.int64]) -> SortedMessages:
        """Sort a block with stamps (m, 2): number, device time in us, both wrapped."""
        return self._follow(stamps) or self._search(stamps.tolist())

    def _follow(self, stamps: NDArray[np.int64]) -> SortedMessages | None:
        """Take a block in which every sample is the next one; None where it is not so."""
        if self._newest is None or self._doubted is not None or not len(stamps):
            return None
        steps = np.diff(stamps, axis=0, prepend=np.array([self._newest]))
        steps_us = steps[:, 1] % TIME_MODULUS_US
        near = (steps_us > 0) & (steps_us < LEAP * self._period_us)
        if not (near & (steps[:, 0] % SEQUENCE_MODULUS == 1)).all():
            return None
        time_us = self._time_us + np.cumsum(steps_us)
        self._period_us = float(steps_us.mean())
        self._place += len(stamps)
        self._newest = int(stamps[-1, 0]), int(stamps[-1, 1])
        self._time_us = int(time_us[-1])
        return SortedMessages(np.arange(len(stamps)), time_us, 0, 0)

    def _search(self, stamps: list[list[int]]) -> SortedMessages:
        """Take a block sample by sample."""
        used: dict[int, tuple[int, int]] = {}  # row and time by place
        handed_on = None if self._newest is None else self._place
        repeated = 0
        for row, (number, time_us) in enumerate(stamps):
            if self._newest is None:
                self._newest, self._time_us = (number, time_us), time_us
                step = step_us = 0
            else:
                step_us = signed_step(time_us, self._newest[1], TIME_MODULUS_US)
                step = self._step(number, step_us)
                agree = (step > 0) == (step_us > 0) and (step == 0) == (step_us == 0)
                if not (agree and -WINDOW < step < LEAP):
                    if not self._follows_doubted(number, time_us):
                        self._doubted = number, time_us
                        continue
                    if not (agree and step > 0):  # the device restarted: its time goes on from here
                        step, step_us = 1, max(1, round(self._period_us))
            self._doubted = None
            place, unwrapped_us = self._place + step, self._time_us + step_us
            if place in used or (handed_on is not None and place <= handed_on):
                repeated += 1
                continue
            used[place] = row, unwrapped_us
            if step > 0:
                if step == 1:
                    self._period_us = float(step_us)
                self._newest, self._place, self._time_us = (number, time_us), place, unwrapped_us
        order = sorted(used)
        before = handed_on if handed_on is not None else order[0] - 1 if order else self._place
        rows = np.array([used[place] for place in order], np.int64).reshape(-1, 2)
        lost = self._place - before - len(order)
        return SortedMessages(rows[:, 0], rows[:, 1], lost, repeated)

    def _step(self, number: int, step_us: int) -> int:
        """Return how many places a sample is from the newest one, by its number and its time."""
        assert self._newest is not None
        step = signed_step(number, self._newest[0], SEQUENCE_MODULUS)
        expected = step_us / self._period_us if self._period_us else step
        return step + SEQUENCE_MODULUS * round((expected - step) / SEQUENCE_MODULUS)

    def _follows_doubted(self, number: int, time_us: int) -> bool:
        """Whether a second sample confirms one that was not accepted."""
        if self._doubted is None:
            return False
        step = signed_step(number, self._doubted[0], SEQUENCE_MODULUS)
        return 0 < step < WINDOW and signed_step(time_us, self._doubted[1], TIME_MODULUS_US) > 0
