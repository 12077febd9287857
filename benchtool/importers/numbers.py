"""Turn cells of a laid-out table into numbers; text among them is blanked or refused in words."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.importers.finding import Finding, counted, line_ranges
from benchtool.importers.text_table import TextTable

Array = NDArray[np.float64]

_NULLS = ["", "nan", "NaN", "NAN", "NA", "N/A", "null", "None", "-"]
_NUMBER = re.compile(
    rb"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[+-]?inf(?:inity)?", re.IGNORECASE
)


@dataclass(frozen=True, slots=True, eq=False)
class Numbers:
    """Hold the numbers of some columns.

    Attributes:
        columns: one (n,) array per asked column; nan where the cell is blank.
        lines: (n,) line of each kept row.
        findings: what was blanked or refused.
    """

    columns: list[Array]
    lines: NDArray[np.intp]
    findings: tuple[Finding, ...]


def numbers_of(table: TextTable, positions: Sequence[int]) -> Numbers:
    """Return the columns at these positions as numbers."""
    import pyarrow as pa

    try:
        columns = [_plain(column) for column in _read(table, positions, pa.float64())]
        findings: list[Finding] = []
        lines = table.lines
    except pa.ArrowInvalid:
        columns, lines, findings = _with_text(table, positions)
    endless = [np.isinf(column) for column in columns]
    many = sum(int(np.count_nonzero(found)) for found in endless)
    if many:
        for column, found in zip(columns, endless, strict=True):
            column[found] = nan
        at = lines[np.logical_or.reduce(endless)]
        findings.append(
            Finding(
                "repaired", "infinite numbers",
                f"{counted(many, 'cell')} that read infinity are blank now",
                count=many, lines=line_ranges(at),
            )
        )  # fmt: skip
    return Numbers(columns, lines, tuple(findings))


def _read(table: TextTable, positions: Sequence[int], cell_type: Any) -> list[Any]:
    """Read the asked columns with pyarrow, which rounds decimals correctly and uses all cores."""
    import pyarrow as pa
    from pyarrow import csv

    names = [str(position) for position in range(len(table.header))]
    wanted = list(dict.fromkeys(names[position] for position in positions))
    longest = int(np.diff(np.flatnonzero(np.frombuffer(table.body, np.uint8) == 10)).max(initial=0))
    read = csv.read_csv(
        pa.BufferReader(table.body),
        read_options=csv.ReadOptions(
            column_names=names, block_size=max(1 << 22, 4 * longest, table.body.find(b"\n") * 4)
        ),
        parse_options=csv.ParseOptions(
            delimiter=table.delimiter, quote_char=False, ignore_empty_lines=False
        ),
        convert_options=csv.ConvertOptions(
            column_types=dict.fromkeys(wanted, cell_type),
            include_columns=wanted,
            null_values=_NULLS,
            strings_can_be_null=True,
            decimal_point=table.decimal,
            check_utf8=False,
        ),
    )
    return [read.column(names[position]) for position in positions]


def _plain(column: Any) -> Array:
    values: Array = np.array(column.to_numpy(), float)
    return values


def _with_text(
    table: TextTable, positions: Sequence[int]
) -> tuple[list[Array], Any, list[Finding]]:
    """Read cell by cell a table in which some cell is no number."""
    import pyarrow as pa

    texts = [column.to_pylist() for column in _read(table, positions, pa.binary())]
    columns = [np.array([_number(cell, table.decimal) for cell in column]) for column in texts]
    blank = [np.array([cell is None or not cell.strip() for cell in column]) for column in texts]
    wrong = [np.isnan(c) & ~b for c, b in zip(columns, blank, strict=True)]
    for column, cells, bad in zip(columns, texts, wrong, strict=True):
        for row in np.flatnonzero(bad).tolist():
            bad[row] = cells[row].strip().decode("latin-1") not in _NULLS
        column[bad] = nan
    bad_cells = np.sum(wrong, axis=0)
    good_cells = np.sum([np.isfinite(column) for column in columns], axis=0)
    refused = (bad_cells > 0) & (bad_cells >= good_cells)
    findings = []
    if refused.any():
        findings.append(
            Finding(
                "refused", "text rows",
                f"{counted(int(refused.sum()), 'row')} that hold text where numbers belong, as "
                f"another script or a second header writes them",
                count=int(refused.sum()), lines=line_ranges(table.lines[refused]),
            )
        )  # fmt: skip
    for position, cells, bad in zip(positions, texts, wrong, strict=True):
        left = np.flatnonzero(bad & ~refused)
        if left.size:
            example = cells[left[0]].decode("utf-8", "replace").strip()[:30]
            findings.append(
                Finding(
                    "repaired", "text cells",
                    f"{counted(left.size, 'cell')} of text, as {example!r}, are blank now",
                    table.header[position], left.size, line_ranges(table.lines[left]),
                )
            )  # fmt: skip
    return [column[~refused] for column in columns], table.lines[~refused], findings


def _number(cell: bytes | None, decimal: str) -> float:
    if cell is None:
        return nan
    clean = cell.strip()
    if decimal == ",":
        clean = clean.replace(b",", b".")
    return float(clean) if _NUMBER.fullmatch(clean) else nan
