"""Conversion of a text table to a recording: channel, unit and numbers of each column."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from math import nan
from typing import NamedTuple

import numpy as np

from benchtool.core.channel import Channel, unit_from_name
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.core.user_file import MAX_NUMBER
from benchtool.data.column_map import (
    IDENTITY,
    MappedColumn,
    find_conversion,
    map_columns,
    match_header,
    parse_header_cell,
    read_column_map,
)
from benchtool.data.csv_text import (
    BLANK_CELLS,
    THOUSANDS,
    Positions,
    TextTable,
    count_character,
    pad_rows,
)
from benchtool.data.parquet import plain_values
from benchtool.data.repairs.import_result import (
    Finding,
    ImportCount,
    ImportOptions,
    ImportResult,
    line_ranges,
)

_BLOCK_BYTES = 1 << 20  # fits a processor's cache; four times as much takes twice as long
_PART_BYTES = 1 << 23  # for one thread; starting readers takes a third at 1 MB; assumed
_PIECE_BYTES = 1 << 16  # read cell by cell if it has text; assumed

_NUMBER = re.compile(
    rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?inf(?:inity)?", re.IGNORECASE
)


class NumericTable(NamedTuple):
    """Numbers of selected columns."""

    table: TextTable  # with rows of one width
    columns: Array  # (c, n) one row per selected column; nan for a blank cell
    lines: Positions  # of each row
    findings: tuple[Finding, ...]  # about blanked cells and refused rows


def parse_numbers(table: TextTable, positions: Sequence[int]) -> NumericTable:
    """Return the columns at these positions as numbers."""
    parsed = _parse_columns(table, positions)
    # With a row of blanks, all sums are nan, which is a faster test.
    if parsed is None or (
        table.is_even
        and all(np.isnan(row.sum()) for row in parsed[0])
        and np.isnan(parsed[0]).all(axis=0).any()
    ):
        return parse_numbers(pad_rows(table), positions)
    columns, texts = parsed
    lines, findings = table.lines, list[Finding]()
    if texts:
        columns, lines, findings = _drop_text(table, positions, columns, texts)
    is_infinite = (columns > MAX_NUMBER) | (columns < -MAX_NUMBER)
    if count := int(np.count_nonzero(is_infinite)):
        columns[is_infinite] = nan
        text = f"{pluralize(count, 'cell')} beyond {MAX_NUMBER:g} or infinite, blanked"
        ranges = line_ranges(lines[is_infinite.any(axis=0)])
        findings.append(Finding("repaired", "infinite numbers", text, count=count, lines=ranges))
    return NumericTable(table, columns, lines, tuple(findings))


Texts = dict[tuple[int, int], bytes]  # cells without a number, by selected column and row


def _parse_columns(table: TextTable, positions: Sequence[int]) -> tuple[Array, Texts] | None:
    """Return columns and their text cells, or None if the rows of an even table may be ragged.

    Threads parse parts of the text. Batches are written directly into the result, as allocating
    more memory takes longer than parsing. pyarrow rounds decimals correctly. Only pieces that it
    rejects are read cell by cell.
    """
    import pyarrow as pa
    from pyarrow import csv

    names = [str(position) for position in range(len(table.header))]
    included = list(dict.fromkeys(names[position] for position in positions))
    values = np.empty((len(positions), len(table.lines)))
    texts: Texts = {}

    def parse(part: memoryview, start: int, end: int) -> bool:
        # The first attempt is faster: one null value, and blocks that may be shorter than a row.
        for nulls, block_bytes in (([""], _BLOCK_BYTES), (BLANK_CELLS, len(part))):
            rows = slice(start, start)
            try:
                for batch in csv.open_csv(
                    pa.BufferReader(pa.py_buffer(part)),
                    csv.ReadOptions(column_names=names, block_size=block_bytes, use_threads=False),
                    csv.ParseOptions(
                        delimiter=table.delimiter, quote_char=False, ignore_empty_lines=False
                    ),
                    csv.ConvertOptions(
                        column_types=dict.fromkeys(included, pa.float64()),
                        include_columns=included,
                        null_values=nulls,
                        decimal_point=table.decimal,
                        check_utf8=False,
                    ),
                ):
                    rows = slice(rows.stop, rows.stop + batch.num_rows)
                    if rows.stop > end:
                        break
                    for row, position in zip(values, positions, strict=True):
                        row[rows] = plain_values(batch.column(names[position]), float, nan)
            except pa.ArrowInvalid:
                continue
            if rows.stop == end:
                return True
        return False

    def read_cells(part: memoryview, start: int) -> None:
        for row, text in enumerate(bytes(part).split(b"\n")[:-1], start):
            cells = text.split(table.delimiter.encode())
            for column, position in enumerate(positions):
                cell = cells[position].strip()
                values[column, row] = number = _number(cell, table.decimal)
                if number != number and cell.decode("latin-1") not in BLANK_CELLS:
                    texts[column, row] = cell

    def read(job: tuple[memoryview, int, int]) -> bool:
        if parse(*job):
            return True
        if table.is_even:
            return False
        for part, start, end in _split_lines(job[0], _PIECE_BYTES, job[1]):
            if not parse(part, start, end):
                read_cells(part, start)
        return True

    jobs = list(_split_lines(table.body, _PART_BYTES))
    try:
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            is_read = all(pool.map(read, jobs))
    except RuntimeError:  # the system refuses a thread
        is_read = all(map(read, jobs))
    return (values, texts) if is_read else None


def _split_lines(
    body: bytes | memoryview, part_bytes: int, row: int = 0
) -> Iterator[tuple[memoryview, int, int]]:
    """Yield parts of whole lines, each with its first row and the row after its last one."""
    text, start = memoryview(body), 0
    while start < len(text):
        line_end = re.compile(b"\n").search(text, start + part_bytes)
        end = line_end.end() if line_end else len(text)
        end_row = row + count_character(text[start:end], "\n")
        yield text[start:end], row, end_row
        start, row = end, end_row


def _drop_text(
    table: TextTable, positions: Sequence[int], columns: Array, texts: Texts
) -> tuple[Array, Positions, list[Finding]]:
    """Return the columns without rows of text, the lines of the others, and the findings."""
    wrong = np.zeros(columns.shape, bool)
    wrong[tuple(np.array([*texts]).T)] = True
    bad_cells = np.sum(wrong, axis=0)
    refused = (bad_cells > 0) & (bad_cells >= np.sum(np.isfinite(columns), axis=0))
    findings = []
    if count := int(refused.sum()):
        text = (
            f"{pluralize(count, 'row')} with text instead of numbers, for example a second header"
        )
        ranges = line_ranges(table.lines[refused])
        findings.append(Finding("refused", "text rows", text, count=count, lines=ranges))
    for column, position in enumerate(positions):
        blanked = np.flatnonzero(wrong[column] & ~refused)
        if blanked.size:
            cell = texts[column, int(blanked[0])]
            example = cell.decode("utf-8", "replace").strip()[:30]
            text = f"{pluralize(blanked.size, 'cell')} of text, as {example!r}, blanked"
            ranges, name = line_ranges(table.lines[blanked]), table.header[position]
            findings.append(Finding("repaired", "text cells", text, name, blanked.size, ranges))
    return np.ascontiguousarray(columns[:, ~refused]), table.lines[~refused], findings


def _number(cell: bytes, decimal: str) -> float:
    if decimal == ",":
        if THOUSANDS.fullmatch(cell.decode("latin-1")):
            cell = cell.replace(b".", b"")
        cell = cell.replace(b",", b".")
    return float(cell) if _NUMBER.fullmatch(cell) else nan


def map_header(
    table: TextTable,
    find_channel: Callable[[str], str | None] | None = None,
    *,
    units: Mapping[str, str] | None = None,
    refuse: bool = True,
    hint: str = "",
) -> tuple[list[MappedColumn], list[Finding]]:
    """Return the known columns of a table, and findings about units and unknown columns.

    Args:
        find_channel: returns the channel for a name without unit, or None; default `match_header`.
        units: unit of columns without one, by channel; the channel's unit by default.
        refuse: a unit of another dimension is an error, else a warning.
    """
    columns: list[MappedColumn] = []
    findings: list[Finding] = []
    unitless: dict[str, str] = {}
    others: list[str] = []
    for position, cell in enumerate(table.header):
        head = parse_header_cell(cell)
        name, unit = (find_channel(head.name), head.unit) if find_channel else match_header(cell)
        if name is None or any(column.name == name for column in columns):
            if head.name:
                others.append(cell)
            continue
        ours = unit_from_name(name)
        file_unit = unit if unit is not None else (units or {}).get(name, ours)
        try:
            scale = find_conversion(file_unit, ours)
        except InputError as error:
            if refuse:
                raise FileFormatError(f"{table.where}, column {cell!r}", str(error)) from error
            findings.append(Finding("doubt", "unit", f"{error}; read as {ours}", name))
            scale = IDENTITY
        if unit is None and head.name != name and ours not in ("1", "count", "rpm"):
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
    facts: Mapping[str, str],
    findings: Sequence[Finding] = (),
    choose: Choose | None = None,
) -> ImportResult:
    """Return the mapped columns of a table as an import; blank columns are dropped.

    `facts` are added to the provenance of the file, `findings` of the header to those of the rows.
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
        recording=Recording(channels, matrix.T, {**facts, "rows": str(rows)}),
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


def read_by_map(table: TextTable, options: ImportOptions) -> ImportResult:
    """Return the columns of a CSV file in the user's map."""
    map_path = options.columns
    assert map_path is not None
    try:
        columns = map_columns(table.header, table.where, read_column_map(map_path))
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
    return read_columns(table, columns, {"columns": str(map_path)}, findings)


def read_by_names(table: TextTable, options: ImportOptions) -> ImportResult:
    """Return the columns of a CSV with known names and units.

    Without a unit the channel's unit is assumed, with a warning.
    """
    hint = "; map them with --columns MAP.toml"
    columns, findings = map_header(table, hint=hint)
    if not columns:
        unknown = ", ".join(list(filter(None, table.header))[:12])
        raise FileFormatError(table.where, f"none of its columns is known ({unknown}){hint}")
    return read_columns(table, columns, {}, findings)
