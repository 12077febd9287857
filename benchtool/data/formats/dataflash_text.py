"""Read an ArduPilot log in its text form (.log): the same records, a line each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.core.counted import counted
from benchtool.data.repairs.imported import Finding, line_ranges


@dataclass(frozen=True, slots=True, eq=False)
class TextLog:
    """Hold a text log's records by name; see `DataFlashLog`, whose methods it has.

    Attributes:
        columns: by message name.
        cells: by message name, each record's cells as text.
        total, broken: whole records, and lines that are none.
        findings: lines that could not be read.
    """

    columns: dict[str, tuple[str, ...]]
    cells: dict[str, list[list[bytes]]]
    total: int
    broken: int
    findings: tuple[Finding, ...]

    def count(self, name: str) -> int:
        return len(self.cells.get(name, ()))

    def has(self, name: str, field: str) -> bool:
        return self.count(name) > 0 and field in self.columns[name]

    def numbers(self, name: str, field: str) -> Array:
        index = self.columns[name].index(field)
        return np.array([_number(row[index]) for row in self.cells[name]])

    def times_us(self, name: str) -> NDArray[np.int64]:
        field, scale = ("TimeUS", 1) if self.has(name, "TimeUS") else ("TimeMS", 1000)
        index = self.columns[name].index(field)
        return np.array([int(row[index]) * scale for row in self.cells[name]], np.int64)

    def texts(self, name: str, field: str) -> list[str]:
        index = self.columns[name].index(field)
        return [row[index].strip().decode("utf-8", "replace") for row in self.cells[name]]


def read_text_log(data: bytes, wanted: frozenset[str]) -> TextLog:
    """Return the wanted kinds of records of a text log."""
    names = {name.encode(): name for name in wanted}
    columns: dict[str, tuple[str, ...]] = {}
    cells: dict[str, list[list[bytes]]] = {name: [] for name in wanted}
    known = {b"FMT"}
    bad: list[int] = []
    lines = data.split(b"\n")
    total = 0
    for number, line in enumerate(lines, 1):
        kind = line[: line.find(b",")].strip() if b"," in line else b""
        if kind == b"FMT":
            parts = [part.strip() for part in line.split(b",")]
            if len(parts) >= 5:
                known.add(parts[3])
                columns[parts[3].decode("latin-1")] = tuple(
                    part.decode("latin-1") for part in parts[5:]
                )
                total += 1
                continue
            bad.append(number)
        elif kind in names:
            row = line.rstrip(b"\r").split(b",")[1:]
            own = columns.get(names[kind], ())
            if own and len(row) >= len(own) and _is_whole(own, row):
                # The last column of a text may hold commas.
                cells[names[kind]].append([*row[: len(own) - 1], b",".join(row[len(own) - 1 :])])
                total += 1
            else:
                bad.append(number)
        elif kind in known:
            total += 1
        elif line.strip():
            bad.append(number)
    findings = []
    if bad:
        words = f"{counted(len(bad), 'line')} hold no whole record"
        findings.append(
            Finding("refused", "broken lines", words, count=len(bad), lines=line_ranges(bad))
        )
    return TextLog(columns, cells, total, len(bad), tuple(findings))


def _is_whole(columns: tuple[str, ...], row: list[bytes]) -> bool:
    """Tell whether a record's time is a whole number that fits."""
    for field in ("TimeUS", "TimeMS"):
        if field in columns:
            cell = row[columns.index(field)].strip()
            return cell.isdigit() and len(cell) < 16
    return True


def _number(cell: bytes) -> float:
    try:
        return float(cell)
    except ValueError:
        return float("nan")
