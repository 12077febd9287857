"""Conversion of a text table to a recording: channel and unit of each column."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence

import numpy as np

from benchtool.core.channel import Channel, unit_from_name
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.data.column_map import (
    IDENTITY,
    MappedColumn,
    map_column,
    match_channel,
    read_column_map,
)
from benchtool.data.csv_header import find_header, most_frequent_delimiter, normalise_rows
from benchtool.data.csv_text import TextTable, parse_rows
from benchtool.data.repairs.foreign_units import find_conversion, parse_header_cell
from benchtool.data.repairs.import_result import Finding, ImportCount, ImportOptions, ImportResult
from benchtool.data.repairs.numbers import parse_numbers


def has_columns(*names: str, any_of: Collection[str] = ()) -> Callable[[bytes], bool]:
    """Return a function that tests a file for these columns; units in brackets are ignored.

    Args:
        names: columns that are all required.
        any_of: columns of which one is required, if not empty.
    """

    def recognizes(head: bytes) -> bool:
        first = find_header(normalise_rows(head.replace(b"\r", b""), []), []).text
        columns = {
            parse_header_cell(cell).name for cell in first.split(most_frequent_delimiter(first))
        }
        return columns.issuperset(names) and (not any_of or not columns.isdisjoint(any_of))

    return recognizes


def map_header(
    table: TextTable,
    find_channel: Callable[[str], str | None],
    *,
    units: Mapping[str, str] | None = None,
    refuse: bool = True,
    hint: str = "",
) -> tuple[list[MappedColumn], list[Finding]]:
    """Return the known columns of a table, and findings about units and unknown columns.

    Args:
        find_channel: returns the channel for a column name without unit, or None if unknown.
        units: unit of columns without one, by channel; the channel's unit by default.
        refuse: a unit of another dimension is an error, else a warning.
        hint: remedy for unknown columns.
    """
    columns: list[MappedColumn] = []
    findings: list[Finding] = []
    unitless: dict[str, str] = {}
    others: list[str] = []
    for position, cell in enumerate(table.header):
        head = parse_header_cell(cell)
        name = find_channel(head.name)
        if name is None or any(column.name == name for column in columns):
            if head.name:
                others.append(cell)
            continue
        ours = unit_from_name(name)
        file_unit = head.unit if head.unit is not None else (units or {}).get(name, ours)
        try:
            scale = find_conversion(file_unit, ours)
        except InputError as error:
            if refuse:
                raise FileFormatError(f"{table.where}, column {cell!r}", str(error)) from error
            findings.append(Finding("doubt", "unit", f"{error}; read as {ours}", name))
            scale = IDENTITY
        if head.unit is None and head.name != name and ours not in ("1", "count", "rpm"):
            unitless[name] = f"{cell} as {file_unit}"
        columns.append(MappedColumn(name=name, position=position, conversion=scale, source=cell))
    if unitless:
        count, text = len(unitless), f"the header names none; read {', '.join(unitless.values())}"
        what, channel = ("units", "") if count > 1 else ("unit", *unitless)
        findings.append(Finding("doubt", what, text, channel, count))
    if others:
        text = f"unknown: {', '.join(others)}{hint}"
        findings.append(Finding("left out", "columns", text, count=len(others)))
    return columns, findings


Choose = Callable[  # (columns, numbers by channel, findings to add to) -> the columns that stay
    [Sequence[MappedColumn], Mapping[str, Array], list[Finding]], Sequence[MappedColumn]
]


def read_columns(
    table: TextTable,
    columns: Sequence[MappedColumn],
    format_name: str,
    provenance: Mapping[str, str],
    findings: Sequence[Finding] = (),
    choose: Choose | None = None,
) -> ImportResult:
    """Return the mapped columns of a table as an import.

    Blank columns are dropped, with a finding.

    Args:
        findings: of the header.
        choose: returns the columns to use, from their numbers.
    """
    positions = [column.position for column in columns if column.position is not None]
    numbers = parse_numbers(table, positions)
    table, rows = numbers.table, len(numbers.lines)
    all_findings = [*table.findings, *findings, *numbers.findings]
    by_position = dict(zip(positions, numbers.columns, strict=True))
    if choose is not None:
        by_name = {c.name: by_position[c.position] for c in columns if c.position is not None}
        columns = choose(columns, by_name, all_findings)
    pairs: list[tuple[MappedColumn, Array]] = []
    empty: list[str] = []
    for column in columns:
        constant = np.broadcast_to(column.constant, rows)
        values = constant if column.position is None else by_position[column.position]
        blank = int(np.count_nonzero(np.isnan(values)))
        if blank == rows and column.position is not None:
            empty.append(column.source)
            continue
        if blank:
            text = (
                f"{blank:,} of {pluralize(rows, 'row')} are blank, as in a channel with a lower "
                f"rate; not filled"
            )
            all_findings.append(Finding("read as", "blank cells", text, column.name, blank))
        pairs.append((column, values))
    if empty:
        text = f"{', '.join(empty)}: blank in every row"
        all_findings.append(Finding("lacks", "blank columns", text, count=len(empty)))
    if not rows or not pairs:
        names = ", ".join(name for name in table.header if name)
        raise FileFormatError(
            table.where, f"no row has numbers in the columns that are read ({names})"
        )
    # Allocating a second table of a million rows takes as long as reading: without constants and
    # shared columns, rows move up within the memory that they were read into.
    unique = len(set(positions)) == len(positions) and all(c.position is not None for c, _ in pairs)
    matrix = numbers.columns[: len(pairs)] if unique else np.empty((len(pairs), rows))
    for row, (column, values) in zip(matrix, pairs, strict=True):
        scale = column.conversion
        if scale.factor != 1.0 or not np.shares_memory(values, row):
            np.multiply(values, scale.factor, out=row)
        if scale.offset:  # added to -0.0, a zero would change it
            row += scale.offset
    channels = tuple(Channel(column.name, unit_from_name(column.name)) for column, _ in pairs)
    return ImportResult(
        recording=Recording(channels, matrix.T, {**provenance, "rows": str(rows)}),
        format=format_name,
        findings=tuple(all_findings),
        tally=ImportCount(
            unit="row",
            total=table.rows_in_file,
            kept=rows,
            refused=sum(finding.count for finding in all_findings if finding.kind == "refused"),
        ),
        sources={column.name: column.source for column, _ in pairs},
        lines=numbers.lines,
    )


def read_by_map(
    data: bytes, where: str, provenance: Mapping[str, str], options: ImportOptions
) -> ImportResult:
    """Return the columns of a CSV file in the user's map."""
    map_path = options.columns
    assert map_path is not None
    table = parse_rows(data, where)
    try:
        columns = [
            map_column(table.header, table.where, *entry)
            for entry in read_column_map(map_path).items()
        ]
    except InputError as error:
        if isinstance(error, FileFormatError):
            raise
        raise FileFormatError(str(map_path), str(error)) from error
    if any(column.reference for column in columns):
        raise InputError(f"reference rows in {map_path} are not supported; use benchtool fit")
    used = {column.position for column in columns}
    unmapped = [head for index, head in enumerate(table.header) if head and index not in used]
    findings = []
    if unmapped:
        text = f"not in the map: {', '.join(unmapped)}"
        findings.append(Finding("left out", "columns", text, count=len(unmapped)))
    return read_columns(
        table, columns, "column map", {**provenance, "columns": str(map_path)}, findings
    )


def read_by_names(
    data: bytes, where: str, provenance: Mapping[str, str], options: ImportOptions
) -> ImportResult:
    """Return the columns of a CSV with known names and units.

    Without a unit the channel's unit is assumed, with a warning.
    """
    table = parse_rows(data, where)
    hint = "; map them with --columns MAP.toml"
    columns, findings = map_header(table, match_channel, hint=hint)
    if not columns:
        unknown = ", ".join(list(filter(None, table.header))[:12])
        raise FileFormatError(
            where,
            f"none of its columns is known ({unknown}); map them with --columns MAP.toml",
        )
    return read_columns(table, columns, "named columns", provenance, findings)
