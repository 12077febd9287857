"""Tables from CSV files, with an optional column map: source column or constant, unit, sign."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import nan
from pathlib import Path

import numpy as np

from benchtool.core.channel import Channel
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.recording import Recording
from benchtool.core.units import Array
from benchtool.core.user_file import MAX_NUMBER
from benchtool.data.atomic import file_hash
from benchtool.data.column_map import ColumnMap, MappedColumn, column_index, map_columns
from benchtool.data.columns import WORDS, find_channel, word_to_code
from benchtool.data.csv_text import BLANK_CELLS, CsvTable, empty_table_error, read_csv_text

_ERROR = re.compile(r".+_(se|sd)(_.+)?")


@dataclass(frozen=True, slots=True)
class RowFilter:
    """Row filter: the cell in `column` equals `value` (as a number if both are numbers)."""

    column: str
    value: str

    @classmethod
    def parse(cls, text: str) -> RowFilter:
        """Parse COLUMN=VALUE, for example `series=Fz0`."""
        column, sign, value = text.partition("=")
        if not sign or not column.strip():
            raise InputError(
                f"{text!r} is not a row filter; write it as COLUMN=VALUE, for example series=Fz0"
            )
        return cls(column.strip(), value.strip())

    def matches(self, cell: str) -> bool:
        """Return whether a stripped cell passes the filter."""
        try:
            return cell == self.value or float(cell) == float(self.value)
        except ValueError:
            return False


def read_table(
    path: str | Path, columns: ColumnMap | None = None, where: Sequence[RowFilter | str] = ()
) -> Recording:
    """Return the rows of a CSV file as a recording.

    Args:
        columns: source of each channel; None means that the file's columns have channel names,
            and columns without numbers are ignored.
        where: row filters, combined by "and".

    Raises:
        FileFormatError: no such file, a cell that is not a number (with its line), no row left.
        MissingColumn: a mapped column is missing; the error lists the file's columns.
        UnknownChoice: the column of a filter is missing.
    """
    table = read_csv_text(Path(path))
    filters = [item if isinstance(item, RowFilter) else RowFilter.parse(item) for item in where]
    table = filter_rows(table, filters)
    if columns:
        chosen = map_columns(table.header, table.where, columns)
        references = {column.position: column.reference for column in chosen if column.reference}
        pairs = [_mapped(table, column, references) for column in chosen]
        if all(np.isnan(values).all() for _, values in pairs):
            raise FileFormatError(table.where, "no numbers in the mapped columns; check the map")
    else:
        pairs = _own_names(table)
    for channel, values in pairs:
        if _ERROR.fullmatch(channel.name):
            _check_range(table, channel.name, values, 1.0 / MAX_NUMBER)
    provenance = {
        "file": table.where,
        "sha256": file_hash(Path(path)),
        "rows": str(len(table.rows)),
        "where": "; ".join(f"{item.column}={item.value}" for item in filters),
        "repairs": "; ".join(table.repairs),
        "simulated": "not stated",
    }
    return Recording.from_columns(pairs, provenance)


def parse_column(table: CsvTable, index: int, blank: str = "") -> Array:
    """Return one column (n,) as numbers; a cell that is blank or `blank` is nan."""
    name, cells = table.header[index], table.rows[:, index]
    numbers = np.where(np.isin(cells, [*BLANK_CELLS, blank]), nan, cells)
    for code, word in enumerate(WORDS.get(name, ())):
        numbers[cells == word] = code
    try:
        values = numbers.astype(float)
    except ValueError:
        row = next(row for row, cell in enumerate(numbers) if not _is_number(cell))
        raise FileFormatError(
            f"{table.where}, line {table.lines[row]}",
            f"column {name!r} contains {cells[row][:40]!r}, which is not a number; correct the "
            f"cell or leave it empty",
        ) from None
    _check_range(table, name, values, -MAX_NUMBER)
    return values


def _check_range(table: CsvTable, name: str, values: Array, lower: float) -> None:
    """Raise FileFormatError for a value outside `lower` to `MAX_NUMBER`; nan and 0 are allowed."""
    wrong = np.flatnonzero(((values < lower) & (values != 0.0)) | (values > MAX_NUMBER))
    if wrong.size:
        raise FileFormatError(
            f"{table.where}, line {table.lines[wrong[0]]}",
            f"{name} is {values[wrong[0]]:g}; allowed: {lower:g} to {MAX_NUMBER:g}; correct the "
            f"cell or leave it empty",
        )


def read_own_table(path: Path, *, follow: bool = True) -> tuple[Recording, tuple[str, ...]]:
    """Return a table that benchtool wrote and a user may have edited, and its repairs."""
    table = read_csv_text(path, is_own=True, follow=follow)
    pairs = [
        (find_channel(name), parse_column(table, index)) for index, name in enumerate(table.header)
    ]
    return Recording.from_columns(pairs), table.repairs


def filter_rows(table: CsvTable, filters: Sequence[RowFilter]) -> CsvTable:
    """Return the rows that pass all filters."""
    if not len(table.rows):
        raise empty_table_error(table.where, table.header)
    for row_filter in filters:
        cells = table.rows[:, column_index(table.header, row_filter.column, table.where)]
        passed = np.array([row_filter.matches(cell) for cell in cells])
        if not passed.any():
            values = list(dict.fromkeys(cells))
            shown_values = ", ".join(values[:12]) + (", ..." if len(values) > 12 else "")
            raise FileFormatError(
                table.where,
                f"no row is left after --where {row_filter.column}={row_filter.value}; the column "
                f"contains: {shown_values}",
            )
        table = replace(table, rows=table.rows[passed], lines=table.lines[passed])
    return table


def _mapped(
    table: CsvTable, column: MappedColumn, references: Mapping[int | None, str]
) -> tuple[Channel, Array]:
    """Return a channel with its numbers; a cell that marks reference rows is nan."""
    channel = find_channel(column.name)
    if column.position is None:
        return channel, np.full(len(table.rows), column.constant)
    if column.reference:
        row_filter = RowFilter("", column.reference)
        is_reference = [row_filter.matches(cell) for cell in table.rows[:, column.position]]
        reference, measure = (word_to_code(column.name, kind) for kind in ("reference", "measure"))
        return channel, np.where(is_reference, reference, measure)
    values = parse_column(table, column.position, references.get(column.position, ""))
    return channel, column.conversion.factor * values + column.conversion.offset


def _own_names(table: CsvTable) -> list[tuple[Channel, Array]]:
    pairs = []
    for index, name in enumerate(table.header):
        try:
            pairs.append((find_channel(name), parse_column(table, index)))
        except FileFormatError:
            # A column of text only is ignored; text in a column with numbers is an error.
            if any(cell not in BLANK_CELLS and _is_number(cell) for cell in table.rows[:, index]):
                raise
    if not pairs:
        raise FileFormatError(
            table.where, "no column contains numbers; map the columns with --columns MAP.toml"
        )
    return pairs


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
