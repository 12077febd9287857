"""Follow the messages of a ULog: count them, say where it ends, and cut out what is broken.

pyulog is given whole messages only. On broken ones it reads on in silence, and where its
definitions are broken it may never come back.
"""

from __future__ import annotations

from dataclasses import dataclass

from benchtool.core.counted import counted
from benchtool.data.repairs.imported import Finding

HEADER_BYTES = 16
_KINDS = frozenset(b"FDIMPQARSOLCB")
"""Types of messages in PX4's ULog format, version 1."""

_DATA = ord("D")
_BODY = frozenset(b"ALCD")
"""Types that stand only after all definitions."""

LONGEST_MESSAGE = 10_000
"""No message is longer in practice; pyulog takes the same bound."""

WHOLE_RUN = 8
"""So many messages in a row that hang together are no chance: reading goes on there."""


@dataclass(frozen=True, slots=True)
class UlogWalk:
    """Hold what was met on the way through a log.

    Attributes:
        whole: the log's bytes without those that are no message.
        data_messages: whole data messages.
        broken: 1 for a data message that the end cuts.
        has_definitions: every definition is whole.
        findings: in words.
    """

    whole: bytes
    data_messages: int
    broken: int
    has_definitions: bool
    findings: tuple[Finding, ...]


def walk_ulog(data: bytes) -> UlogWalk:
    """Follow the lengths of a log's messages to its end, over stretches that make no sense."""
    at, size, messages, broken = HEADER_BYTES, len(data), 0, 0
    begin, pieces, gaps = 0, [], []
    has_body = False
    kinds, body, is_data, longest = _KINDS, _BODY, _DATA, LONGEST_MESSAGE
    findings: list[Finding] = []
    while at + 3 <= size:
        kind, length = data[at + 2], data[at] + (data[at + 1] << 8)
        after = at + 3 + length
        if kind not in kinds or not 0 < length < longest:
            pieces.append(data[begin:at])
            if not has_body:
                words = f"the definitions break at byte {at:,} of {size:,}"
                findings.append(Finding("refused", "corrupt bytes", words))
                begin = at = size
                break
            begin = _next_run(data, at + 1)
            gaps.append((at, begin - at))
            at = begin
            continue
        if after > size:
            break
        has_body = has_body or kind in body
        messages += kind == is_data
        at = after
    pieces.append(data[begin:at])
    if gaps:
        lost = sum(length for _, length in gaps)
        words = (
            f"{lost:,} bytes in {counted(len(gaps), 'place')} are no message, first at byte "
            f"{gaps[0][0]:,}; reading went on at the next run of messages"
        )
        findings.append(Finding("refused", "corrupt bytes", words))
    if at < size:
        broken = int(at + 2 < size and data[at + 2] == is_data)
        words = f"the log ends at byte {size:,} in the middle of a message that begins at {at:,}"
        findings.append(Finding("refused", "cut off", words, count=broken))
    return UlogWalk(b"".join(pieces), messages, broken, has_body, tuple(findings))


def _next_run(data: bytes, at: int) -> int:
    """Return where the next messages begin that hang together; the end where none do."""
    size = len(data)
    while at + 3 <= size:
        if data[at + 2] in _KINDS and _runs(data, at):
            return at
        at += 1
    return size


def _runs(data: bytes, at: int) -> bool:
    for _ in range(WHOLE_RUN):
        if at == len(data):
            return True
        if at + 3 > len(data) or data[at + 2] not in _KINDS:
            return False
        length = data[at] + (data[at + 1] << 8)
        if not 0 < length < LONGEST_MESSAGE:
            return False
        at += 3 + length
    return at <= len(data)
