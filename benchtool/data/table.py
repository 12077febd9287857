"""Read any CSV through a map of columns: our name = their column or a constant, unit, sign."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.array import Array
from benchtool.core.channel import Channel
from benchtool.core.column_source import ColumnSource
from benchtool.core.errors import FileFormatError, InputError, MissingColumn, UnknownChoice
from benchtool.core.recording import Recording
from benchtool.core.toml_text import build
from benchtool.core.units import UNITS, from_si, same_dimension, to_si
from benchtool.data.atomic import file_hash
from benchtool.data.columns import WORDS, channel_called
from benchtool.data.csv_text import CsvTable, no_rows, read_csv_text

_BLANK = frozenset({"", "nan", "NaN", "NAN", "NA", "N/A", "null"})


ColumnMap = Mapping[str, ColumnSource | Mapping[str, Any] | str]
"""Our name to where it comes from; a plain text is the file's column in our unit."""


@dataclass(frozen=True, slots=True)
class Where:
    """Keep only rows whose cell in `column` is `value` (as a number when both are numbers)."""

    column: str
    value: str

    @classmethod
    def parse(cls, text: str) -> Where:
        """Read `series=Fz0`."""
        column, sign, value = text.partition("=")
        if not sign or not column.strip():
            raise InputError(
                f"{text!r} filters no rows; write it as COLUMN=VALUE, for example series=Fz0"
            )
        return cls(column.strip(), value.strip())

    def holds(self, cell: str) -> bool:
        """Return whether a row with this cell, without blanks around it, stays."""
        try:
            return cell == self.value or float(cell) == float(self.value)
        except ValueError:
            return False


def read_table(
    path: str | Path, columns: ColumnMap | None = None, where: Sequence[Where | str] = ()
) -> Recording:
    """Return the rows of a CSV file as a recording.

    Args:
        columns: our columns and where each comes from; left out, the file's columns must carry
            our names, and those that hold no number are left out.
        where: row filters, all of which must hold.

    Raises:
        FileFormatError: no such file, a cell that is no number (with its line), no row left.
        MissingColumn: a mapped column that the file has not, with those that it has.
        UnknownChoice: the same of a filter's column.
    """
    table = read_csv_text(Path(path))
    filters = [item if isinstance(item, Where) else Where.parse(item) for item in where]
    rows = _filtered(table, filters)
    if columns:
        pairs = [_mapped(table, rows, name, source) for name, source in columns.items()]
        if all(np.isnan(values).all() for _, values in pairs):
            raise FileFormatError(table.where, "the mapped columns hold no numbers; check the map")
    else:
        pairs = _own_names(table, rows)
    provenance = {
        "file": table.where,
        "sha256": file_hash(Path(path)),
        "rows": str(len(rows)),
        "where": "; ".join(f"{item.column}={item.value}" for item in filters),
        "repairs": "; ".join(table.repairs),
        "simulated": "not stated",
    }
    return Recording.from_columns(pairs, provenance)


def numbers_in(table: CsvTable, index: int, rows: Sequence[int]) -> Array:
    """Return one column (n,) of those rows as numbers; a blank cell is nan."""
    name = table.header[index]
    words = WORDS.get(name, ())
    values = np.full(len(rows), nan)
    for position, row in enumerate(rows):
        cell = table.rows[row][index].strip()
        if cell in _BLANK:
            continue
        try:
            values[position] = words.index(cell) if cell in words else float(cell)
        except ValueError:
            raise FileFormatError(
                f"{table.where}, line {table.lines[row]}",
                f"column {name!r} holds {cell[:40]!r}, which is no number; mend the cell or leave "
                f"it empty",
            ) from None
    return values


def columns_of(table: CsvTable) -> list[tuple[Channel, Array]]:
    """Return every column of one of our own files with its channel."""
    rows = range(len(table.rows))
    return [
        (channel_called(name), numbers_in(table, index, rows))
        for index, name in enumerate(table.header)
    ]


def _filtered(table: CsvTable, filters: Sequence[Where]) -> list[int]:
    rows = list(range(len(table.rows)))
    if not rows:
        raise no_rows(table.where, table.header)
    for item in filters:
        index = index_of(table.header, item.column, table.where)
        cells = {row: table.rows[row][index].strip() for row in rows}
        rows = [row for row, cell in cells.items() if item.holds(cell)]
        if not rows:
            values = list(dict.fromkeys(cells.values()))
            known = ", ".join(values[:12]) + (", ..." if len(values) > 12 else "")
            raise FileFormatError(
                table.where,
                f"no row is left after --where {item.column}={item.value}; the column holds: "
                f"{known}",
            )
    return rows


def index_of(header: Sequence[str], column: str, where: str) -> int:
    """Return where a column stands; one that stands twice, or not at all, is refused."""
    column = column.strip()
    if (many := header.count(column)) > 1:
        raise FileFormatError(
            where, f"column {column!r} stands {many} times in the header; rename all but one"
        )
    if not many:
        raise UnknownChoice(f"column of {where}", column, filter(None, header))
    return header.index(column)


def _mapped(
    table: CsvTable, rows: Sequence[int], name: str, source: ColumnSource | Mapping[str, Any] | str
) -> tuple[Channel, Array]:
    if isinstance(source, str):
        source = ColumnSource(column=source)
    elif not isinstance(source, ColumnSource):
        source = build(ColumnSource, source, f"[columns] {name}")
    channel = channel_called(name)
    unit = source.unit or channel.unit
    same_dimension(unit, channel.unit)
    if source.column is None:
        assert source.constant is not None
        values = np.full(len(rows), source.constant)
    else:
        if source.column.strip() not in table.header:
            raise MissingColumn(table.where, source.column, table.header)
        if source.unit is None and source.factor == 1.0:
            _refuse_other_unit(name, source.column, channel.unit)
        values = numbers_in(table, index_of(table.header, source.column, table.where), rows)
    values = source.sign * source.factor * values
    if unit != channel.unit:
        values = np.asarray(from_si(to_si(values, unit), channel.unit), float)
    return channel, values


_UNIT_IN_BRACKETS = re.compile(r"[(\[]\s*([^()\[\]]+?)\s*[)\]]\s*$")

_FOREIGN_UNITS = frozenset({"lb", "lbf", "oz", "ozf", "in", "inch", "ft", "mv", "ma", "kn"})


def _refuse_other_unit(name: str, column: str, unit: str) -> None:
    """Refuse a map without a unit for a column whose own name carries another one than ours."""
    found = _UNIT_IN_BRACKETS.search(column)
    theirs = found[1] if found else unit
    known = {symbol.casefold() for symbol in UNITS} | _FOREIGN_UNITS
    if theirs.casefold() in known and theirs.casefold() != unit.casefold():
        raise InputError(
            f"column {column!r} names the unit {theirs!r}, and {name} without one is read in "
            f"{unit}; write its unit in [columns]: {name} = {{ column = {column!r}, unit = '?' }} "
            f"(grams of a scale are gf)"
        )


def _own_names(table: CsvTable, rows: Sequence[int]) -> list[tuple[Channel, Array]]:
    pairs = []
    for index, name in enumerate(table.header):
        try:
            pairs.append((channel_called(name), numbers_in(table, index, rows)))
        except FileFormatError:
            # A column of words alone is left out; one with a number among them has a slip.
            if any(_is_number(table.rows[row][index].strip()) for row in rows):
                raise
    if not pairs:
        raise FileFormatError(
            table.where, "no column holds numbers; map the file's columns with --columns MAP.toml"
        )
    return pairs


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return text not in _BLANK
