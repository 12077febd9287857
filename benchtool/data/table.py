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
from benchtool.data.columns import WORDS, channel_called, code_of
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

    def keeps(self, cell: str) -> bool:
        """Tell whether a row with this cell stays."""
        cell = cell.strip()
        if cell == self.value:
            return True
        try:
            return float(cell) == float(self.value)
        except ValueError:
            return False


def read_table(
    path: str | Path,
    columns: ColumnMap | None = None,
    where: Sequence[Where | str] = (),
) -> Recording:
    """Return the rows of a CSV file as a recording.

    Args:
        path: the file.
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
    kept = _filtered(table, filters)
    if columns:
        pairs = [_mapped(table, kept, name, source) for name, source in columns.items()]
        if not any(not np.isnan(values).all() for _, values in pairs):
            raise FileFormatError(table.where, "the mapped columns hold no numbers; check the map")
    else:
        pairs = _own_names(table, kept)
    provenance = {
        "file": table.where,
        "sha256": file_hash(Path(path)),
        "rows": str(len(kept)),
        "where": "; ".join(f"{item.column}={item.value}" for item in filters),
        "repairs": "; ".join(table.repairs),
        "simulated": "not stated",
    }
    return Recording.from_columns(pairs, provenance)


def numbers_in(table: CsvTable, index: int, rows: Sequence[int]) -> Array:
    """Return one column (n,) of those rows as numbers; a blank cell is nan."""
    name = table.header[index]
    words = WORDS.get(name)
    values = np.empty(len(rows))
    for position, row in enumerate(rows):
        cell = table.rows[row][index].strip()
        if cell in _BLANK:
            values[position] = nan
            continue
        try:
            values[position] = float(cell)
        except ValueError:
            if words and cell in words:
                values[position] = code_of(name, cell)
                continue
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
    kept = list(range(len(table.rows)))
    if not kept:
        raise no_rows(table.where, table.header)
    for item in filters:
        index = _index(table, item.column)
        left = [row for row in kept if item.keeps(table.rows[row][index])]
        if not left:
            values = dict.fromkeys(table.rows[row][index].strip() for row in kept)
            known = ", ".join(list(values)[:12]) + (", ..." if len(values) > 12 else "")
            raise FileFormatError(
                table.where,
                f"no row is left after --where {item.column}={item.value}; the column holds: "
                f"{known}",
            )
        kept = left
    return kept


def _index(table: CsvTable, column: str) -> int:
    if table.header.count(column.strip()) > 1:
        raise FileFormatError(
            table.where,
            f"column {column.strip()!r} stands {table.header.count(column.strip())} times in the "
            f"header; rename all but one",
        )
    try:
        return table.header.index(column.strip())
    except ValueError:
        raise UnknownChoice(f"column of {table.where}", column, table.header) from None


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
        index = _index(table, source.column)
        values = numbers_in(table, index, rows)
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
            texts = {table.rows[row][index].strip() for row in rows}
            if any(_is_number(text) for text in texts):
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
