r"""Bytes of the bench protocol: text lines with a checksum, encoded and decoded. Pure functions.

A line is ``$<payload>*<CRC>\n``; the CRC-16/CCITT-FALSE of the payload is four hexadecimal digits.
The payload's first letter is its type; `docs/reference/bench-protocol.md` has the whole table.
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
from benchtool.core.units import Array

CRC_START = 0xFFFF  # CRC-16/CCITT-FALSE (polynomial 0x1021, no reflection, no final xor)
MAX_LINE_BYTES = 512  # longest line that a receiver buffers; longer lines are discarded


def crc16(payload: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE of the payload; of ``123456789`` it is 0x29B1."""
    return crc_hqx(payload, CRC_START)


def frame(payload: bytes) -> bytes:
    """Return the payload as a line ready to send."""
    return b"$%b*%04X\n" % (payload, crc16(payload))


def build_payload(letter: str, fields: Iterable[str]) -> bytes:
    """Return text fields as a payload; characters that would break the line become blanks."""
    text = ",".join((letter, *fields))
    return text.translate(_UNSAFE).encode("ascii", "replace")


def frame_fields(letter: str, fields: Iterable[str]) -> bytes:
    """Return text fields as a line."""
    return frame(build_payload(letter, fields))


_UNSAFE = str.maketrans({"$": " ", "*": " ", "\n": " ", "\r": " "})

HEARTBEAT = frame(b"B")


def frame_command(number: int, command: Command, time_us: int = 0) -> bytes:
    """Return a command as a line, with its number and the last device time that the host read."""
    name, *arguments = command_fields(command)
    time = () if isinstance(command, RequestHello) else (str(time_us % TIME_MODULUS_US),)
    return frame_fields("C", (str(number), name, *time, *arguments))


class TextMessage(NamedTuple):
    """One line that is not a sample: its letter and its text fields."""

    letter: str
    fields: tuple[str, ...]


class Decoder:
    """Decoder of byte chunks of any size into readings in host time, and into messages.

    Invalid bytes never raise. A line without a valid frame counts as corrupt, except before the
    first valid frame, where a link starts in the middle of a line or a board prints its boot text.
    A corrupt sample counts twice: as corrupt and as lost.
    """

    def __init__(self, n_channels: int | None = None) -> None:
        self._partial_line = b""
        self._is_overlong = False
        self._is_synchronised = False
        self._messages: list[TextMessage] = []
        self.expect(n_channels)

    def expect(self, n_channels: int | None, speed: float = 1.0) -> None:
        """Decode samples of this width from now on, with a new order and clock; None skips them."""
        self._n_channels = n_channels
        self._order, self._clock = SampleOrder(), DeviceClock(speed)

    def take_messages(self) -> list[TextMessage]:
        """Return and clear the received lines that are no samples, in order."""
        messages, self._messages = self._messages, []
        return messages

    def feed(self, data: bytes, arrived_s: float = 0.0) -> Readings:
        """Decode the lines that `data` completes, received at a bench time."""
        *lines, self._partial_line = (self._partial_line + data).split(b"\n")
        if self._is_overlong and lines:
            lines[0] = b"?" * (MAX_LINE_BYTES + 1)
            self._is_overlong = False
        if len(self._partial_line) > MAX_LINE_BYTES:
            self._is_overlong = True
        if self._is_overlong:
            self._partial_line = b""
        samples: list[bytes] = []
        corrupt = 0
        for line in lines:
            # Fast path: exactly one complete frame.
            payload = line[1:-5]
            if line[:1] == b"$" and line[-5:-4] == b"*" and _is_valid(payload, line[-4:]):
                payloads = [payload]
            else:
                payloads = _find_payloads(line)
            if not payloads:
                corrupt += self._is_synchronised and bool(line.strip())
                continue
            self._is_synchronised = True
            for payload in payloads:
                if payload[:2] == b"S,":
                    samples.append(payload[2:])
                elif payload:
                    letter, *fields = payload.decode("ascii", "replace").split(",")
                    self._messages.append(TextMessage(letter, tuple(fields)))
        if self._n_channels is None or not samples:
            empty = np.empty(0)
            return Readings(empty, empty, np.empty((0, self._n_channels or 0)), corrupt=corrupt)
        width = self._n_channels + 2
        table = _parse_table(samples, width)
        if table is None:
            tables = (_parse_table([sample], width) for sample in samples)
            rows = [row for row in tables if row is not None]
            corrupt += len(samples) - len(rows)
            table = np.concatenate(rows) if rows else np.empty((0, width))
        sorted_samples = self._order.sort(table[:, :2].astype(np.int64).tolist())
        if sorted_samples.time_us:
            self._clock.update(sorted_samples.time_us[-1], arrived_s)
        device_time_us = np.array(sorted_samples.time_us, float)
        return Readings(
            time_s=self._clock.host_time_s(device_time_us),
            device_time_us=device_time_us,
            values=table[sorted_samples.rows][:, 2:],
            lost=sorted_samples.lost,
            corrupt=corrupt,
            repeated=sorted_samples.repeated,
        )


def split_messages(data: bytes) -> list[TextMessage]:
    """Return the text messages in bytes whose protocol is not known yet."""
    decoder = Decoder()
    decoder.feed(data)
    return decoder.take_messages()


def _is_valid(payload: bytes, digits: bytes) -> bool:
    try:
        return len(payload) <= MAX_LINE_BYTES - 6 and crc16(payload) == int(digits, 16)
    except ValueError:
        return False


def _find_payloads(line: bytes) -> list[bytes]:
    """Return the payloads of all valid frames in a line that is not just one frame."""
    if len(line) > MAX_LINE_BYTES:
        return []
    pieces = [piece.rpartition(b"*") for piece in line.removesuffix(b"\r").split(b"$")[1:]]
    return [
        payload
        for payload, star, digits in pieces
        if star and len(digits) == 4 and _is_valid(payload, digits)
    ]


def _parse_table(samples: Sequence[bytes], width: int) -> Array | None:
    """Return samples (m, width) as numbers, or None if one of them is invalid."""
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
    for number, time_us in table[:, :2].tolist():
        # nan fails the comparison, so an empty number or time is rejected as well.
        if not (0.0 <= number < SEQUENCE_MODULUS and 0.0 <= time_us < TIME_MODULUS_US):
            return None
    return table


@dataclass(slots=True)
class SampleFramer:
    """Formatter of samples of `n_channels` values, numbered, as a device prints them."""

    n_channels: int
    sequence: int = 0

    def frames(self, device_time_us: NDArray[np.int64], values: Array) -> list[bytes]:
        """Return one line per row of values (m, c) at device times (m,): us; nan becomes empty."""
        template = "S,%d,%d" + ",%.7g" * self.n_channels
        lines = []
        for time_us, row in zip(device_time_us.tolist(), values.tolist(), strict=True):
            text = template % (self.sequence, time_us % TIME_MODULUS_US, *row)
            lines.append(frame(text.replace("nan", "").encode("ascii")))
            self.sequence = (self.sequence + 1) % SEQUENCE_MODULUS
        return lines


SEQUENCE_MODULUS = 1 << 16
TIME_MODULUS_US = 1 << 32
REORDER_WINDOW = 64  # largest delay in samples; radios and UDP reorder neighbours; assumed

# Largest jump ahead, 4 s at 1 kHz; beyond it the number passed the checksum by chance, or the
# device restarted; assumed.
MAX_LEAP = 4096


def signed_step(new: int, old: int, modulus: int) -> int:
    """Return the step of a wrapping count, negative for a step back (RFC 1982)."""
    half = modulus // 2
    return (new - old + half) % modulus - half


class SortedSamples(NamedTuple):
    """Samples of a block in their order."""

    rows: list[int] | slice  # (m,) indices into the block
    time_us: list[int]  # (m,) their device time, unwrapped
    lost: int  # samples that are missing before or between them
    repeated: int  # discarded samples: duplicates, or later than a returned one


class SampleOrder:
    """Order of samples by their numbers and device times.

    Within a block samples are sorted. The number of a sample wraps: a gap longer than half of its
    range is identified by device time, once two consecutive samples have given the period.
    """

    def __init__(self) -> None:
        self._newest: tuple[int, int] | None = None  # number and time as sent
        self._position = 0  # of the newest sample, counted over all wraps
        self._time_us = 0  # of the newest sample, unwrapped
        self._period_us = 0.0
        self._rejected: tuple[int, int] | None = None

    def sort(self, stamps: Sequence[Sequence[int]]) -> SortedSamples:
        """Sort a block with stamps: number, device time in us, both wrapped."""
        return self._sort_consecutive(stamps) or self._sort_one_by_one(stamps)

    def _sort_consecutive(self, stamps: Sequence[Sequence[int]]) -> SortedSamples | None:
        """Return the block if its samples are consecutive, else None."""
        if self._newest is None or self._rejected is not None or not stamps:
            return None
        (last_number, last_us), unwrapped_us = self._newest, self._time_us
        max_step_us, times_us = MAX_LEAP * self._period_us, []
        for number, time_us in stamps:
            step_us = (time_us - last_us) % TIME_MODULUS_US
            is_next = (number - last_number) % SEQUENCE_MODULUS == 1
            if not (is_next and 0 < step_us < max_step_us):
                return None
            last_number, last_us = number, time_us
            unwrapped_us += step_us
            times_us.append(unwrapped_us)
        self._period_us = (unwrapped_us - self._time_us) / len(stamps)
        self._position += len(stamps)
        self._newest, self._time_us = (last_number, last_us), unwrapped_us
        return SortedSamples(slice(None), times_us, 0, 0)

    def _sort_one_by_one(self, stamps: Sequence[Sequence[int]]) -> SortedSamples:
        """Return the block, which may have lost, repeated or reordered samples."""
        used_rows: dict[int, tuple[int, int]] = {}  # row and time by position
        returned = None if self._newest is None else self._position
        repeated = 0
        for row, (number, time_us) in enumerate(stamps):
            if self._newest is None:
                self._newest, self._time_us = (number, time_us), time_us
                step = step_us = 0
            else:
                step_us = signed_step(time_us, self._newest[1], TIME_MODULUS_US)
                step = self._count_step(number, step_us)
                is_consistent = (step > 0) == (step_us > 0) and (step == 0) == (step_us == 0)
                if not (is_consistent and -REORDER_WINDOW < step < MAX_LEAP):
                    if not self._confirms_rejected(number, time_us):
                        self._rejected = number, time_us
                        continue
                    if not (is_consistent and step > 0):  # restarted: its time continues from here
                        step, step_us = 1, max(1, round(self._period_us))
            self._rejected = None
            position, unwrapped_us = self._position + step, self._time_us + step_us
            if position in used_rows or (returned is not None and position <= returned):
                repeated += 1
                continue
            used_rows[position] = row, unwrapped_us
            if step > 0:
                if step == 1:
                    self._period_us = float(step_us)
                self._newest, self._position, self._time_us = (
                    (number, time_us),
                    position,
                    unwrapped_us,
                )
        order = sorted(used_rows)
        start = returned if returned is not None else order[0] - 1 if order else self._position
        rows = [used_rows[position][0] for position in order]
        times_us = [used_rows[position][1] for position in order]
        return SortedSamples(rows, times_us, self._position - start - len(order), repeated)

    def _count_step(self, number: int, step_us: int) -> int:
        """Return the distance of a sample from the newest one, by its number and its time."""
        assert self._newest is not None
        step = signed_step(number, self._newest[0], SEQUENCE_MODULUS)
        expected_step = step_us / self._period_us if self._period_us else step
        return step + SEQUENCE_MODULUS * round((expected_step - step) / SEQUENCE_MODULUS)

    def _confirms_rejected(self, number: int, time_us: int) -> bool:
        """Return whether a second sample confirms one that was rejected."""
        if self._rejected is None:
            return False
        step = signed_step(number, self._rejected[0], SEQUENCE_MODULUS)
        return (
            0 < step < REORDER_WINDOW
            and signed_step(time_us, self._rejected[1], TIME_MODULUS_US) > 0
        )
