"""Walk through a MAVLink telemetry log (.tlog): time stamps, frames, and what lies between."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from benchtool.core.plural import pluralize
from benchtool.data.repairs.import_result import Finding

STAMP_BYTES = 8
V1, V2 = 0xFE, 0xFD
SIGNATURE_BYTES = 13
_SIGNED = 0x01
EARLIEST_US, LATEST_US = 946684800_000000, 4102444800_000000  # 2000 to 2100


class Frame(NamedTuple):
    """Hold one frame: when the host got it, the system and component that sent it, its payload."""

    time_us: int
    sender: tuple[int, int]
    payload: bytes


class TlogWalk(NamedTuple):
    """Hold the frames of the wanted kinds by message number, and the account of all.

    Attributes:
        total: whole frames of any kind.
        broken: frames whose checksum is wrong, or that the end cuts.
    """

    frames: dict[int, list[Frame]]
    total: int
    broken: int
    findings: list[Finding]


def is_tlog(data: bytes) -> bool:
    """Return whether bytes begin as a telemetry log does."""
    if len(data) < STAMP_BYTES + 8 or data[STAMP_BYTES] not in (V1, V2):
        return False
    return EARLIEST_US <= int.from_bytes(data[:STAMP_BYTES], "big") <= LATEST_US


def walk_tlog(data: bytes, extras: dict[int, int], checksum: Callable[[bytes], int]) -> TlogWalk:
    """Return the frames of a log.

    Args:
        extras: CRC_EXTRA of each wanted message number; other numbers are counted unchecked.
        checksum: of MAVLink, over a frame without its first byte and with CRC_EXTRA at its end.
    """
    frames: dict[int, list[Frame]] = {number: [] for number in extras}
    at, size, total, broken, lost, first_lost = 0, len(data), 0, 0, 0, -1
    cut = ""
    while at + STAMP_BYTES < size:
        begin = at + STAMP_BYTES
        length = _frame_length(data, begin)
        time_us = int.from_bytes(data[at:begin], "big")
        if not length or not EARLIEST_US <= time_us <= LATEST_US:
            after = _next_start(data, at + 1)
            lost += after - at
            first_lost = at if first_lost < 0 else first_lost
            at = after
            continue
        end = begin + length
        if end > size:
            cut = f"the log ends at byte {size:,} in the middle of a frame that begins at {begin:,}"
            broken += 1
            break
        if data[begin] == V2:
            number = data[begin + 7] | data[begin + 8] << 8 | data[begin + 9] << 16
            head, system = 10, begin + 5
        else:
            number, head, system = data[begin + 5], 6, begin + 3
        extra = extras.get(number)
        if extra is not None:
            stop = begin + head + data[begin + 1]
            if (
                checksum(data[begin + 1 : stop] + bytes((extra,)))
                != data[stop] | data[stop + 1] << 8
            ):
                broken += 1
                at = end if _starts(data, end) else _next_start(data, at + 1)
                continue
            frames[number].append(
                Frame(time_us, (data[system], data[system + 1]), data[begin + head : stop])
            )
        total += 1
        at = end
    if not cut and 0 < size - at <= STAMP_BYTES:
        cut = f"the log ends at byte {size:,} in the middle of a time stamp"
    return TlogWalk(frames, total, broken, _losses(lost, first_lost, broken - bool(cut), cut))


def _frame_length(data: bytes, begin: int) -> int:
    """Return the length of the frame that begins here; 0 where none does."""
    if begin + 2 >= len(data):
        return 0
    if data[begin] == V1:
        return 8 + data[begin + 1]
    if data[begin] != V2:
        return 0
    return 12 + data[begin + 1] + (SIGNATURE_BYTES if data[begin + 2] & _SIGNED else 0)


def _starts(data: bytes, at: int) -> bool:
    """Return whether a stamp and a frame begin here, or the file ends."""
    return at >= len(data) or _frame_length(data, at + STAMP_BYTES) > 0


def _next_start(data: bytes, at: int) -> int:
    """Return the next place where a plausible stamp stands before a frame's first byte."""
    size = len(data)
    while at + STAMP_BYTES < size:
        one, two = (data.find(bytes((magic,)), at + STAMP_BYTES) for magic in (V1, V2))
        found = min(place for place in (one, two, size) if place >= 0)
        if found == size:
            return size
        at = found - STAMP_BYTES
        if EARLIEST_US <= int.from_bytes(data[at:found], "big") <= LATEST_US:
            return at
        at += 1
    return size


def _losses(lost: int, first_lost: int, wrong: int, cut: str) -> list[Finding]:
    found = []
    if lost:
        words = (
            f"{pluralize(lost, 'byte')} of no frame, first at byte {first_lost:,}; reading went on "
            f"after"
        )
        found.append(Finding("refused", "corrupt bytes", words))
    if wrong > 0:
        words = f"{pluralize(wrong, 'frame')} with a wrong checksum"
        found.append(Finding("refused", "corrupt frames", words, count=wrong))
    if cut:
        found.append(Finding("refused", "cut off", cut, count=int("frame" in cut)))
    return found
