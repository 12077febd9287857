"""Count the messages of a ULog and say where it ends; pyulog reads on in silence."""

from __future__ import annotations

from dataclasses import dataclass

from benchtool.importers.finding import Finding

HEADER_BYTES = 16
_KINDS = frozenset(b"FDIMPQARSOLCB")
"""Types of messages in PX4's ULog format, version 1."""

_DATA, _FLAGS = ord("D"), ord("B")


@dataclass(frozen=True, slots=True)
class UlogWalk:
    """Hold what was met on the way through a log.

    Attributes:
        data_messages: whole data messages.
        broken: 1 for a message that the end cuts.
        corrupt: the lengths lead to something that is no message.
        findings: in words.
    """

    data_messages: int
    broken: int
    corrupt: bool
    findings: tuple[Finding, ...]


def walk_ulog(data: bytes) -> UlogWalk:
    """Follow the lengths of a log's messages to its end, or to where they stop making sense."""
    at, size, messages = HEADER_BYTES, len(data), 0
    kinds, is_data = _KINDS, _DATA
    while at + 3 <= size:
        kind = data[at + 2]
        after = at + 3 + data[at] + (data[at + 1] << 8)
        if kind not in kinds or after == at + 3:
            words = (
                f"what begins at byte {at:,} of {size:,} is no message; from there on only what "
                f"pyulog finds again is read"
            )
            found = Finding("refused", "corrupt bytes", words)
            return UlogWalk(messages, 0, True, (found,))
        if after > size:
            words = (
                f"the log ends at byte {size:,} in the middle of a message that begins at {at:,}"
            )
            cut = Finding("refused", "cut off", words, count=int(kind == is_data))
            return UlogWalk(messages, int(kind == is_data), False, (cut,))
        messages += kind == is_data
        at = after
    return UlogWalk(messages, 0, False, ())
