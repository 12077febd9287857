"""Parser of MAVLink telemetry logs (.tlog): time stamps, frames and corrupt bytes."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from benchtool.core.text import pluralize
from benchtool.data.formats.flight_log import MessageLog
from benchtool.data.repairs.import_result import Finding

STAMP_BYTES = 8
V1, V2 = 0xFE, 0xFD
SIGNATURE_BYTES = 13
_SIGNED = 0x01
MIN_STAMP_US, MAX_STAMP_US = 946684800_000000, 4102444800_000000  # 2000 to 2100


class Frame(NamedTuple):
    """Frame: time of reception by the host, system and component of the sender, payload."""

    time_us: int
    sender: tuple[int, int]
    payload: bytes


def is_tlog(data: bytes) -> bool:
    """Return whether bytes begin like a telemetry log."""
    if len(data) < STAMP_BYTES + 8 or data[STAMP_BYTES] not in (V1, V2):
        return False
    return MIN_STAMP_US <= int.from_bytes(data[:STAMP_BYTES], "big") <= MAX_STAMP_US


def walk_tlog(
    data: bytes, extras: dict[int, int], checksum: Callable[[bytes], int]
) -> tuple[dict[int, list[Frame]], MessageLog]:
    """Return the frames of the selected kinds by message number, and the counts of all frames.

    Args:
        extras: CRC_EXTRA by selected message number; others are counted without a check.
        checksum: of MAVLink, over a frame without its first byte and with CRC_EXTRA at its end.
    """
    frames: dict[int, list[Frame]] = {number: [] for number in extras}
    offset, size, total, broken, lost, first_lost = 0, len(data), 0, 0, 0, -1
    cut = ""
    while offset + STAMP_BYTES < size:
        begin = offset + STAMP_BYTES
        length = _frame_length(data, begin)
        time_us = int.from_bytes(data[offset:begin], "big")
        if not length or not MIN_STAMP_US <= time_us <= MAX_STAMP_US:
            next_offset = _next_start(data, offset + 1)
            lost += next_offset - offset
            first_lost = offset if first_lost < 0 else first_lost
            offset = next_offset
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
                is_start = end >= size or _frame_length(data, end + STAMP_BYTES) > 0
                offset = end if is_start else _next_start(data, offset + 1)
                continue
            frames[number].append(
                Frame(time_us, (data[system], data[system + 1]), data[begin + head : stop])
            )
        total += 1
        offset = end
    if not cut and 0 < size - offset <= STAMP_BYTES:
        cut = f"the log ends at byte {size:,} in the middle of a time stamp"
    findings = _report_losses(lost, first_lost, broken - bool(cut), cut)
    return frames, MessageLog(total=total, broken=broken, findings=findings)


def _frame_length(data: bytes, begin: int) -> int:
    """Return the length of the frame that begins here, or 0 without a frame."""
    if begin + 2 >= len(data):
        return 0
    if data[begin] == V1:
        return 8 + data[begin + 1]
    if data[begin] != V2:
        return 0
    return 12 + data[begin + 1] + (SIGNATURE_BYTES if data[begin + 2] & _SIGNED else 0)


def _next_start(data: bytes, offset: int) -> int:
    """Return the next offset of a plausible time stamp before a frame's first byte."""
    size = len(data)
    while offset + STAMP_BYTES < size:
        v1_start, v2_start = (
            data.find(bytes((magic,)), offset + STAMP_BYTES) for magic in (V1, V2)
        )
        start = min(position for position in (v1_start, v2_start, size) if position >= 0)
        if start == size:
            return size
        offset = start - STAMP_BYTES
        if MIN_STAMP_US <= int.from_bytes(data[offset:start], "big") <= MAX_STAMP_US:
            return offset
        offset += 1
    return size


def _report_losses(lost: int, first_lost: int, n_wrong: int, cut: str) -> list[Finding]:
    findings = []
    if lost:
        text = f"{pluralize(lost, 'byte')} outside frames, first at byte {first_lost:,}; skipped"
        findings.append(Finding("refused", "corrupt bytes", text))
    if n_wrong > 0:
        text = f"{pluralize(n_wrong, 'frame')} with a wrong checksum"
        findings.append(Finding("refused", "corrupt frames", text, count=n_wrong))
    if cut:
        findings.append(Finding("refused", "cut off", cut, count=int("frame" in cut)))
    return findings
