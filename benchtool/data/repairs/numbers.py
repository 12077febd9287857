"""Parser of table cells as numbers; text cells are blanked or their rows refused."""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import nan
from typing import Any, NamedTuple

import numpy as np

from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.core.user_file import MAX_NUMBER
from benchtool.data.csv_text import THOUSANDS, Positions, TextTable, pad_rows
from benchtool.data.repairs.import_result import Finding, line_ranges
from benchtool.data.run.sample_stream import plain_values

_BLOCK_BYTES = 1 << 20  # fits a processor's cache; four times as much takes twice as long

_NULLS = ["", "nan", "NaN", "NAN", "NA", "N/A", "null", "None", "-"]
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
    columns, lines, findings = _floats(table, positions), table.lines, list[Finding]()
    # With a row of blanks, all sums are nan, which is a faster test.
    if table.is_even and (
        columns is None
        or (np.isnan(columns.sum(axis=1)).all() and np.isnan(columns).all(axis=0).any())
    ):
        return parse_numbers(pad_rows(table), positions)
    if columns is None:
        columns, lines, findings = _with_text(table, positions)
    is_infinite = np.abs(columns) > MAX_NUMBER
    if count := int(np.count_nonzero(is_infinite)):
        columns[is_infinite] = nan
        text = f"{pluralize(count, 'cell')} beyond {MAX_NUMBER:g} or infinite, blanked"
        ranges = line_ranges(lines[is_infinite.any(axis=0)])
        findings.append(Finding("repaired", "infinite numbers", text, count=count, lines=ranges))
    return NumericTable(table, columns, lines, tuple(findings))


def _floats(table: TextTable, positions: Sequence[int]) -> Array | None:
    """Return columns without text cells, or None if there are any.

    The first attempt has one null value, which is faster. Batches are written directly into the
    result, as allocating more memory takes longer than parsing.
    """
    import pyarrow as pa

    values = np.empty((len(positions), len(table.lines)))
    for blank in ([""], _NULLS):
        end = 0
        try:
            for batch in _reader(table, positions, pa.float64(), blank):
                start, end = end, end + batch.num_rows
                if end > values.shape[1]:
                    break
                for row, position in zip(values, positions, strict=True):
                    row[start:end] = plain_values(batch.column(str(position)), float, nan)
        except pa.ArrowInvalid:
            continue
        if end == values.shape[1]:
            return values
    return None


def _reader(
    table: TextTable, positions: Sequence[int], cell_type: Any, blank: Sequence[str]
) -> Any:
    """Return a pyarrow reader of these columns; it rounds decimals correctly."""
    import pyarrow as pa
    from pyarrow import csv

    names = [str(position) for position in range(len(table.header))]
    included = list(dict.fromkeys(names[position] for position in positions))
    return csv.open_csv(
        pa.BufferReader(pa.py_buffer(table.body)),
        read_options=csv.ReadOptions(
            column_names=names, block_size=_block_bytes(table.body), use_threads=False
        ),
        parse_options=csv.ParseOptions(
            delimiter=table.delimiter, quote_char=False, ignore_empty_lines=False
        ),
        convert_options=csv.ConvertOptions(
            column_types=dict.fromkeys(included, cell_type),
            include_columns=included,
            null_values=blank,
            strings_can_be_null=True,
            decimal_point=table.decimal,
            check_utf8=False,
        ),
    )


def _block_bytes(body: bytes | memoryview) -> int:
    """Return a block size for pyarrow, at least the longest row; usually `_BLOCK_BYTES`."""
    offset = 0
    while len(body) - offset > _BLOCK_BYTES:
        end = bytes(body[offset : offset + _BLOCK_BYTES]).rfind(b"\n")
        if end < 0:
            return min(len(body), (1 << 31) - 1)
        offset += end + 1
    return _BLOCK_BYTES


def _with_text(table: TextTable, positions: Sequence[int]) -> tuple[Array, Any, list[Finding]]:
    """Return numbers, lines and findings of a table with text cells, read cell by cell."""
    import pyarrow as pa

    arrow_table = _reader(table, positions, pa.binary(), _NULLS).read_all()
    texts = [arrow_table.column(str(position)).to_pylist() for position in positions]
    columns = np.array([[_number(cell, table.decimal) for cell in column] for column in texts])
    wrong = np.array([[_is_text(cell) for cell in column] for column in texts]) & np.isnan(columns)
    columns[wrong] = nan
    bad_cells = np.sum(wrong, axis=0)
    refused = (bad_cells > 0) & (bad_cells >= np.sum(np.isfinite(columns), axis=0))
    findings = []
    if count := int(refused.sum()):
        text = (
            f"{pluralize(count, 'row')} with text instead of numbers, for example a second header"
        )
        ranges = line_ranges(table.lines[refused])
        findings.append(Finding("refused", "text rows", text, count=count, lines=ranges))
    for position, cells, bad in zip(positions, texts, wrong, strict=True):
        blanked = np.flatnonzero(bad & ~refused)
        if blanked.size:
            example = cells[blanked[0]].decode("utf-8", "replace").strip()[:30]
            text = f"{pluralize(blanked.size, 'cell')} of text, as {example!r}, blanked"
            ranges, name = line_ranges(table.lines[blanked]), table.header[position]
            findings.append(Finding("repaired", "text cells", text, name, blanked.size, ranges))
    return np.ascontiguousarray(columns[:, ~refused]), table.lines[~refused], findings


def _is_text(cell: bytes | None) -> bool:
    """Return whether a cell that is not a number is text and not a null value."""
    return cell is not None and cell.strip().decode("latin-1") not in _NULLS


def _number(cell: bytes | None, decimal: str) -> float:
    clean = b"" if cell is None else cell.strip()
    if decimal == ",":
        if THOUSANDS.fullmatch(clean.decode("latin-1")):
            clean = clean.replace(b".", b"")
        clean = clean.replace(b",", b".")
    return float(clean) if _NUMBER.fullmatch(clean) else nan
