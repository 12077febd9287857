"""Reader of ArduPilot DataFlash logs, binary or text.

Binary format as in ArduPilot's LogStructure.h: each record is 0xA3 0x95, a type, and a body whose
layout is in an FMT record (type 128). It is read column by column with NumPy; numbers are equal to
those of pymavlink's DFReader.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.text import pluralize
from benchtool.data.formats.flight_log import MessageLog, Messages
from benchtool.data.repairs.import_result import Finding, line_ranges

Positions = NDArray[np.intp]

HEAD = b"\xa3\x95"
FMT_TYPE, FMT_LENGTH = 0x80, 89

_TYPES: dict[str, tuple[str, float]] = {  # NumPy type and divisor by format letter
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


@dataclass(frozen=True, slots=True)
class RecordLayout:
    """Layout from an FMT record: name, length with header, format letters, columns."""

    name: str
    length: int
    letters: str
    columns: tuple[str, ...]

    @property
    def dtype(self) -> np.dtype[np.void] | None:
        """Type of the body; None if letters, columns and length are inconsistent."""
        if set(self.letters) - set(_TYPES) or len(self.columns) != len(self.letters):
            return None
        fields = [(f"f{i}", _TYPES[letter][0]) for i, letter in enumerate(self.letters)]
        body = np.dtype(fields)
        return body if body.itemsize == self.length - 3 else None

    def messages(self, bodies: NDArray[np.void]) -> Messages:
        """Return the bodies of such records (m,) as messages; the first of duplicate columns."""
        fields, divisors = {}, {}
        for i, (name, letter) in enumerate(zip(self.columns, self.letters, strict=True)):
            if name not in fields:
                fields[name], divisors[name] = bodies[f"f{i}"], _TYPES[letter][1]
        return Messages(self.name, _times_us(fields), fields, divisors)


def _times_us(fields: Mapping[str, NDArray[Any]]) -> NDArray[np.int64] | None:
    """Return records' times (m,) in microseconds since boot, or None without a time column."""
    for name, scale in (("TimeUS", 1), ("TimeMS", 1000)):
        if name in fields and fields[name].dtype.kind in "iuf":
            times: NDArray[np.int64] = fields[name].astype(np.int64) * scale
            return times
    return None


def read_dataflash(data: bytes, selected: frozenset[str]) -> MessageLog:
    """Return the selected kinds of records of a log, with findings for unused bytes."""
    text = np.frombuffer(data, np.uint8)
    heads = np.flatnonzero((text[:-2] == HEAD[0]) & (text[1:-1] == HEAD[1]))
    layouts = _layouts(data, heads[text[heads + 2] == FMT_TYPE])
    starts, ends = _chain(text, heads, layouts)
    confirmed = _layouts(data, starts[text[starts + 2] == FMT_TYPE])
    if confirmed != layouts:
        # An apparent FMT record was part of another record's body.
        layouts = confirmed
        starts, ends = _chain(text, heads, layouts)
    broken = int(starts.size > 0 and ends[-1] > text.size)
    findings = _account(text.size, starts, ends)
    if broken:
        starts = starts[:-1]
    total = int(starts.size)
    types = text[starts + 2]
    kinds: dict[str, Messages] = {}
    for number, layout in layouts.items():
        if layout.name not in selected:
            continue
        rows = starts[types == number]
        body = layout.dtype
        if body is not None:
            kinds[layout.name] = layout.messages(_bodies(text, rows, body))
        elif rows.size:
            message = f"{pluralize(rows.size, 'record')} of {layout.name}: inconsistent FMT record"
            findings.append(Finding("refused", "broken format", message, layout.name, rows.size))
            broken += int(rows.size)
            total -= int(rows.size)
    return MessageLog(kinds=kinds, total=total, broken=broken, findings=findings)


def _layouts(data: bytes, starts: Positions) -> dict[int, RecordLayout]:
    layouts = {FMT_TYPE: RecordLayout("FMT", FMT_LENGTH, "BBnNZ", ())}
    for start in starts.tolist():
        if start + FMT_LENGTH > len(data):
            continue
        kind, length, name, letters, columns = struct.unpack_from("<BB4s16s64s", data, start + 3)
        texts = [raw.split(b"\0")[0].decode("latin-1") for raw in (name, letters, columns)]
        if length >= 3 and kind != FMT_TYPE:
            layouts[kind] = RecordLayout(texts[0], length, texts[1], tuple(texts[2].split(",")))
    return layouts


def _chain(
    text: NDArray[np.uint8], heads: Positions, layouts: dict[int, RecordLayout]
) -> tuple[Positions, Positions]:
    """Return the offsets at which records begin and end; records do not overlap.

    The two bytes of a record's head also occur by chance inside bodies (one in 65,000 positions);
    following the lengths skips them. The loop runs only over gaps between records.
    """
    lengths = np.zeros(256, np.intp)
    for kind, layout in layouts.items():
        lengths[kind] = layout.length
    heads = heads[lengths[text[heads + 2]] > 0]
    ends = heads + lengths[text[heads + 2]]
    successors = np.searchsorted(heads, ends)
    jumps = np.flatnonzero(successors != np.arange(heads.size) + 1)
    is_record = np.zeros(heads.size, bool)
    index = 0
    for jump in jumps.tolist():
        if jump < index:
            continue
        is_record[index : jump + 1] = True
        index = int(successors[jump])
    is_record[index:] = True
    return heads[is_record], ends[is_record]


def _account(size: int, starts: Positions, ends: Positions) -> list[Finding]:
    """Return findings for bytes outside records, and for a truncated last record."""
    begins = np.concatenate([starts, [size]])
    stops = np.minimum(np.concatenate([[0], ends]), size)
    gaps = begins - stops
    inside, findings = gaps[:-1], []
    n_gaps = int(np.count_nonzero(inside > 0))
    if n_gaps:
        lost, first = int(inside.sum()), int(stops[np.flatnonzero(inside > 0)[0]])
        message = (
            f"{lost:,} bytes in {pluralize(n_gaps, 'place')} belong to no record, first at byte "
            f"{first:,}; skipped to the next record"
        )
        findings.append(Finding("refused", "corrupt bytes", message, count=0))
    if starts.size and ends[-1] > size:
        length = int(ends[-1] - starts[-1])
        message = (
            f"the log ends at byte {size:,} in the middle of a record of {length} bytes that "
            f"begins at byte {int(starts[-1]):,}"
        )
        findings.append(Finding("refused", "cut off", message, count=1))
    elif gaps[-1] > 0:
        remaining = pluralize(int(gaps[-1]), "byte")
        message = f"the last record ends at byte {int(stops[-1]):,}, {remaining} before the end"
        findings.append(Finding("refused", "corrupt bytes", message, count=0))
    return findings


def _bodies(
    text: NDArray[np.uint8], starts: Positions, body: np.dtype[np.void]
) -> NDArray[np.void]:
    """Return the bodies that begin three bytes after these positions (m,)."""
    if not starts.size or not body.itemsize:
        return np.zeros(0, body)
    views = np.lib.stride_tricks.sliding_window_view(text, body.itemsize)
    raw = np.ascontiguousarray(views[starts + 3])
    records: NDArray[np.void] = raw.view(body).reshape(-1)
    return records


def read_text_log(data: bytes, selected: frozenset[str]) -> MessageLog:
    """Return the selected kinds of records of a log in text form, one record per line."""
    names = {name.encode(): name for name in selected}
    columns: dict[str, tuple[str, ...]] = {}
    rows: dict[str, list[list[bytes]]] = {name: [] for name in selected}
    known_kinds = {b"FMT"}
    bad: list[int] = []
    total = 0
    for number, line in enumerate(data.split(b"\n"), 1):
        kind, comma, body = line.partition(b",")
        kind = kind.strip() if comma else b""
        cells = body.rstrip(b"\r").split(b",")
        if kind == b"FMT" and len(cells) >= 4:
            name = cells[2].strip()
            known_kinds.add(name)
            fields = tuple(cell.strip().decode("latin-1") for cell in cells[4:])
            columns.setdefault(name.decode("latin-1"), fields)
        elif kind in names:
            layout = columns.get(names[kind], ())
            if not layout or len(cells) < len(layout) or not _has_time(layout, cells):
                bad.append(number)
                continue
            # The last column may contain commas.
            cells[len(layout) - 1 :] = [b",".join(cells[len(layout) - 1 :])]
            rows[names[kind]].append([cell.strip() for cell in cells])
        elif kind == b"FMT" or kind not in known_kinds:
            bad += [number] if line.strip() else []
            continue
        total += 1
    findings = []
    if bad:
        message = f"{pluralize(len(bad), 'line')} without a complete record"
        lines = line_ranges(bad)
        findings.append(Finding("refused", "broken lines", message, count=len(bad), lines=lines))
    kinds = {
        name: _text_messages(name, columns[name], cells) for name, cells in rows.items() if cells
    }
    return MessageLog(kinds=kinds, total=total, broken=len(bad), findings=findings)


def _has_time(columns: tuple[str, ...], row: list[bytes]) -> bool:
    """Return whether a record's time is a whole number of at most 15 digits."""
    for name in ("TimeUS", "TimeMS"):
        if name in columns:
            cell = row[columns.index(name)].strip()
            return cell.isdigit() and len(cell) < 16
    return True


def _text_messages(name: str, columns: tuple[str, ...], rows: list[list[bytes]]) -> Messages:
    """Return lines as messages; the first of duplicate columns."""
    fields: dict[str, NDArray[Any]] = {}
    for column, cells in zip(columns, zip(*rows, strict=True), strict=True):
        fields.setdefault(column, np.array(cells))
    for time in {"TimeUS", "TimeMS"} & set(fields):
        fields[time] = fields[time].astype(np.int64)
    return Messages(name, _times_us(fields), fields)
