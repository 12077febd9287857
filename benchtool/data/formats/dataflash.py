"""Read the self-describing records of an ArduPilot DataFlash log, column by column with NumPy.

Format as in ArduPilot's LogStructure.h: each record is 0xA3 0x95, a type, and a body whose layout
an FMT record (type 128) gives. Numbers come out as pymavlink's DFReader gives them.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.core.counted import counted
from benchtool.data.repairs.imported import Finding

Positions = NDArray[np.intp]

HEAD = b"\xa3\x95"
FMT_TYPE, FMT_LENGTH = 0x80, 89

_TYPES: dict[str, tuple[str, float]] = {
    "a": ("V64", 1.0),
    "b": ("i1", 1.0),
    "B": ("u1", 1.0),
    "g": ("<f2", 1.0),
    "h": ("<i2", 1.0),
    "H": ("<u2", 1.0),
    "i": ("<i4", 1.0),
    "I": ("<u4", 1.0),
    "f": ("<f4", 1.0),
    "n": ("S4", 1.0),
    "N": ("S16", 1.0),
    "Z": ("S64", 1.0),
    "c": ("<i2", 100.0),
    "C": ("<u2", 100.0),
    "e": ("<i4", 100.0),
    "E": ("<u4", 100.0),
    "L": ("<i4", 1e7),
    "d": ("<f8", 1.0),
    "M": ("i1", 1.0),
    "q": ("<i8", 1.0),
    "Q": ("<u8", 1.0),
}
"""Letters of a format, NumPy's type for each, and what its numbers are divided by."""


@dataclass(frozen=True, slots=True)
class RecordLayout:
    """Hold what an FMT record says about a type: name, length with header, letters, columns."""

    name: str
    length: int
    letters: str
    columns: tuple[str, ...]

    @property
    def dtype(self) -> np.dtype[np.void] | None:
        """The body's layout; None where letters and length do not agree."""
        if any(letter not in _TYPES for letter in self.letters):
            return None
        fields = [(f"f{i}", _TYPES[letter][0]) for i, letter in enumerate(self.letters)]
        body = np.dtype(fields)
        return body if body.itemsize == self.length - 3 else None


@dataclass(frozen=True, slots=True, eq=False)
class DataFlashLog:
    """Hold a log's records by name.

    Attributes:
        layouts: by message name.
        bodies: by message name, (m,) structured arrays of the records' bodies.
        total: whole records in the log.
        broken: records cut off by the end of the file.
        findings: bytes that are no record, and where the log ends.
    """

    layouts: dict[str, RecordLayout]
    bodies: dict[str, NDArray[np.void]]
    total: int
    broken: int
    findings: tuple[Finding, ...]

    def count(self, name: str) -> int:
        """Return how many records of a kind there are."""
        return len(self.bodies[name]) if name in self.bodies else 0

    def has(self, name: str, field: str) -> bool:
        """Tell whether records of a kind stand in the log and have a field."""
        return self.count(name) > 0 and field in self.layouts[name].columns

    def numbers(self, name: str, field: str) -> Array:
        """Return one field of all records of a kind (m,), scaled as its letter says."""
        index = self.layouts[name].columns.index(field)
        _, divisor = _TYPES[self.layouts[name].letters[index]]
        values: Array = self.bodies[name][f"f{index}"].astype(float)
        return values / divisor if divisor != 1.0 else values

    def times_us(self, name: str) -> NDArray[np.int64]:
        """Return the records' times (m,) in microseconds since boot."""
        field, scale = ("TimeUS", 1) if self.has(name, "TimeUS") else ("TimeMS", 1000)
        index = self.layouts[name].columns.index(field)
        times: NDArray[np.int64] = self.bodies[name][f"f{index}"].astype(np.int64) * scale
        return times

    def texts(self, name: str, field: str) -> list[str]:
        """Return one field of all records of a kind as text."""
        index = self.layouts[name].columns.index(field)
        raw = self.bodies[name][f"f{index}"].tolist()
        return [bytes(item).split(b"\0")[0].decode("latin-1") for item in raw]


def read_dataflash(data: bytes, wanted: frozenset[str]) -> DataFlashLog:
    """Return the wanted kinds of records of a log, and an account of all its bytes."""
    text = np.frombuffer(data, np.uint8)
    heads = np.flatnonzero((text[:-2] == HEAD[0]) & (text[1:-1] == HEAD[1]))
    layouts = _layouts(data, heads[text[heads + 2] == FMT_TYPE])
    starts, ends = _chain(text, heads, layouts)
    confirmed = _layouts(data, starts[text[starts + 2] == FMT_TYPE])
    if confirmed != layouts:
        # What looked like an FMT record within another record's body was none.
        layouts = confirmed
        starts, ends = _chain(text, heads, layouts)
    broken = int(starts.size > 0 and ends[-1] > text.size)
    findings = _account(text.size, starts, ends)
    if broken:
        starts = starts[:-1]
    kinds = text[starts + 2]
    bodies: dict[str, NDArray[np.void]] = {}
    by_name: dict[str, RecordLayout] = {}
    for kind, layout in layouts.items():
        if layout.name not in wanted:
            continue
        at = starts[kinds == kind]
        body = layout.dtype
        if body is None or len(layout.columns) != len(layout.letters):
            if at.size:
                words = f"{counted(at.size, 'record')} of {layout.name}: its FMT contradicts itself"
                findings.append(Finding("refused", "broken format", words, layout.name, at.size))
                broken += int(at.size)
            continue
        by_name[layout.name] = layout
        bodies[layout.name] = _gathered(text, at, body)
    total = int(starts.size) - sum(item.count for item in findings if item.what == "broken format")
    return DataFlashLog(by_name, bodies, total, broken, tuple(findings))


def _layouts(data: bytes, starts: Positions) -> dict[int, RecordLayout]:
    found = {FMT_TYPE: RecordLayout("FMT", FMT_LENGTH, "BBnNZ", ())}
    for at in starts.tolist():
        if at + FMT_LENGTH > len(data):
            continue
        kind, length, name, letters, columns = struct.unpack_from("<BB4s16s64s", data, at + 3)
        texts = [item.split(b"\0")[0].decode("latin-1") for item in (name, letters, columns)]
        if length >= 3 and kind != FMT_TYPE:
            found[kind] = RecordLayout(texts[0], length, texts[1], tuple(texts[2].split(",")))
    return found


def _chain(
    text: NDArray[np.uint8], heads: Positions, layouts: dict[int, RecordLayout]
) -> tuple[Positions, Positions]:
    """Return where records begin and end: each begins at or after the end of the one before.

    Two bytes like a record's head also stand by chance inside bodies (one in 65,000 positions);
    following the lengths passes them over. Where every record follows the one before, nothing is
    looped over.
    """
    lengths = np.zeros(256, np.intp)
    for kind, layout in layouts.items():
        lengths[kind] = layout.length
    heads = heads[lengths[text[heads + 2]] > 0]
    ends = heads + lengths[text[heads + 2]]
    after = np.searchsorted(heads, ends)
    jumps = np.flatnonzero(after != np.arange(heads.size) + 1)
    whole = np.zeros(heads.size, bool)
    at = 0
    for jump in jumps.tolist():
        if jump < at:
            continue
        whole[at : jump + 1] = True
        at = int(after[jump])
    whole[at:] = True
    return heads[whole], ends[whole]


def _account(size: int, starts: Positions, ends: Positions) -> list[Finding]:
    """Tell the bytes that belong to no record, and a record that the end cuts."""
    begins = np.concatenate([starts, [size]])
    stops = np.minimum(np.concatenate([[0], ends]), size)
    gaps = begins - stops
    inside, found = gaps[:-1], []
    many = int(np.count_nonzero(inside > 0))
    if many:
        lost, first = int(inside.sum()), int(stops[np.flatnonzero(inside > 0)[0]])
        words = (
            f"{lost:,} bytes in {counted(many, 'place')} belong to no record, first at byte "
            f"{first:,}; reading went on at the next record"
        )
        found.append(Finding("refused", "corrupt bytes", words, count=0))
    if starts.size and ends[-1] > size:
        length = int(ends[-1] - starts[-1])
        words = (
            f"the log ends at byte {size:,} in the middle of a record of {length} bytes that "
            f"begins at byte {int(starts[-1]):,}"
        )
        found.append(Finding("refused", "cut off", words, count=1))
    elif gaps[-1] > 0:
        rest = counted(int(gaps[-1]), "byte")
        words = f"the last record ends at byte {int(stops[-1]):,}, {rest} before the end"
        found.append(Finding("refused", "corrupt bytes", words, count=0))
    return found


def _gathered(
    text: NDArray[np.uint8], starts: Positions, body: np.dtype[np.void]
) -> NDArray[np.void]:
    """Return the bodies that begin three bytes after these positions (m,)."""
    if not starts.size or not body.itemsize:
        return np.zeros(0, body)
    views = np.lib.stride_tricks.sliding_window_view(text, body.itemsize)
    raw = np.ascontiguousarray(views[starts + 3])
    records: NDArray[np.void] = raw.view(body).reshape(-1)
    return records
