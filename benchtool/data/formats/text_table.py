"""Lay out the rows of foreign CSV bytes: every line retained, mended with words, or refused.

Nothing is turned into numbers here; the bytes stay bytes, so that a million rows take as long as
finding their commas does.
"""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.counted import counted
from benchtool.core.errors import FileFormatError
from benchtool.core.table_bounds import check_columns
from benchtool.data.csv_text import (
    BYTE_ORDER_MARK,
    Repairs,
    decode,
    delimiter_of,
    no_rows,
    plain_text,
)
from benchtool.data.repairs.imported import Finding, line_ranges

Positions = NDArray[np.intp]

_DECIMAL_COMMA = re.compile(rb"(?:^|[;\t])\s*[+-]?\d+,\d")
_START_BYTES = 1 << 16
_PIECE_BYTES = 1 << 18


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TextTable:
    """Hold the rows of a text file, all of one width.

    Attributes:
        where: the file's path as given.
        header: (w,) column names without surrounding blanks; "" for a column without a name.
        body: the rows, each of w cells, ended by a newline; a view of the file where that was even.
        lines: (n,) line number of each row in the file, from 1.
        delimiter: one character.
        decimal: "." or ",".
        rows_in_file: lines below the header that hold anything.
        findings: what was mended or refused.
        is_even: every row looks as wide as the header; a reader that finds otherwise evens it.
    """

    where: str
    header: tuple[str, ...]
    body: bytes | memoryview
    lines: Positions
    delimiter: str
    decimal: str
    rows_in_file: int
    findings: tuple[Finding, ...]
    is_even: bool


def lay_out(data: bytes, where: str) -> TextTable:
    """Return the rows of CSV bytes.

    Raises:
        FileFormatError: no text, no header, or no row below it.
    """
    repairs: Repairs = []
    data = plain_text(data, where, repairs)
    first, header_line, rest_at = _header_line(data, repairs)
    delimiter = delimiter_of(first, repairs)
    body: bytes | memoryview = memoryview(data)[rest_at:]
    line_of = None
    if b'"' in data:
        first, body, line_of = _unquoted(first, data[rest_at:], delimiter, where)
    check_columns(first.count(delimiter) + 1, where)
    names = tuple(cell.strip() for cell in first.split(delimiter))
    if not any(names):
        raise FileFormatError(where, "the first line names no columns; add a header line")
    decimal = "."
    if delimiter != "," and _DECIMAL_COMMA.search(bytes(body[:_START_BYTES])):
        decimal = ","
        repairs.append(("decimal commas", "decimal commas are read as points"))
    rows = _count(body, "\n")
    if line_of is None:
        line_of = np.arange(1, rows + 1 + (body[-1:] != b"\n"))
    table = TextTable(
        where=where,
        header=names,
        body=body,
        lines=header_line + line_of,
        delimiter=delimiter,
        decimal=decimal,
        rows_in_file=rows,
        findings=tuple(Finding("repaired", what, words) for what, words in repairs),
        is_even=False,
    )
    return replace(table, is_even=True) if _looks_even(table) else evened(table)


def _header_line(data: bytes, repairs: Repairs) -> tuple[str, int, int]:
    """Return the header as text, its line number, and where the rows begin."""
    at, line = len(BYTE_ORDER_MARK) if data.startswith(BYTE_ORDER_MARK) else 0, 0
    while at < len(data):
        end = data.find(b"\n", at)
        end = len(data) if end < 0 else end
        line += 1
        raw, at = data[at:end], end + 1
        if raw.lower().startswith(b"sep="):
            repairs.append(("spreadsheet's line", "a first line 'sep=' was left out"))
        elif raw.strip():
            break
    text = decode(raw, "the header", repairs)
    # A name may reach a terminal, and must give it no orders.
    text = "".join(letter if letter.isprintable() or letter == "\t" else "�" for letter in text)
    return text, line, min(at, len(data))


def _unquoted(first: str, body: bytes, delimiter: str, where: str) -> tuple[str, bytes, Positions]:
    """Return header and rows without quotes, and the line of each row, counted from the header's.

    A delimiter or line end within quotes becomes a blank: no number holds one.
    """
    clean = str.maketrans({delimiter: " ", "\n": " "})
    text = io.StringIO(f"{first}\n{body.decode('utf-8', 'replace')}", newline="")
    reader = csv.reader(text, delimiter=delimiter)
    rows, lines = [], []
    try:
        for row in reader:
            rows.append(delimiter.join(cell.translate(clean) for cell in row))
            lines.append(reader.line_num - 1)
    except csv.Error as error:
        problem = f"line {reader.line_num} cannot be read: {error}; mend that line"
        raise FileFormatError(where, problem) from error
    whole = "".join(f"{row}\n" for row in rows[1:])
    if not body.endswith(b"\n") and rows[-1]:
        whole = whole[:-1]
    return rows[0], whole.encode(), np.array(lines[1:], np.intp)


def _looks_even(table: TextTable) -> bool:
    """Tell whether the rows hold as many cells as the header in all, and none is empty.

    Counting takes no time. Whether one row is short by what another has too many, and whether some
    are empty, shows in reading.
    """
    wanted = (len(table.header) - 1) * table.rows_in_file
    return table.body[-1:] == b"\n" and _count(table.body, table.delimiter) == wanted


def _count(body: bytes | memoryview, letter: str) -> int:
    """Return how often a letter stands in the rows, counted in pieces that fit a cache."""
    text, code = np.frombuffer(body, np.uint8), ord(letter)
    pieces = range(0, text.size, _PIECE_BYTES)
    return sum(int(np.count_nonzero(text[at : at + _PIECE_BYTES] == code)) for at in pieces)


_NEWLINE, _CUT = 10, "the last line was cut"


def evened(table: TextTable) -> TextTable:
    """Return the table with rows of one width, and findings that say what was done."""
    body, delimiter, lines = bytes(table.body), table.delimiter, table.lines
    names, findings = list(table.header), list(table.findings)
    cut_at_end = bool(body) and not body.endswith(b"\n")
    if cut_at_end:
        body += b"\n"
    text = np.frombuffer(body, np.uint8)
    ends = np.flatnonzero(text == _NEWLINE)
    starts = np.concatenate([[0], ends[:-1] + 1]) if ends.size else ends
    marks = np.flatnonzero(text == ord(delimiter))
    counts = np.diff(np.searchsorted(marks, ends), prepend=0)
    blank = (ends - starts == 0) | ((counts > 0) & (ends - starts == counts))
    blank_rows = int(np.count_nonzero(blank & (counts > 0)))
    used = counts[~blank] + 1
    if not used.size:
        raise no_rows(table.where, table.header)
    while len(names) > 1 and not names[-1]:
        names.pop()
    # A reader that asks to even a table knows its columns already.
    width = len(table.header) if table.is_even else _width(used, len(names))
    irregular = np.flatnonzero(~blank & (counts + 1 != width))
    if not irregular.size and not blank.any():
        retained, whole = np.ones(ends.size, bool), body
    else:
        retained, whole = _mended(
            body, starts, ends, blank, irregular, width, delimiter, lines, cut_at_end, findings
        )
    if cut_at_end and retained[-1]:
        findings.append(
            Finding(
                "doubt", "no last line end",
                "the file ends without a line end; its last number may be cut", lines=str(lines[-1])
            )
        )  # fmt: skip
    if blank_rows:
        _repaired(
            findings, "empty rows", f"{counted(blank_rows, 'row')} of empty cells left out",
            count=blank_rows,
        )  # fmt: skip
    _report_widths(used, names, width, findings)
    header = (*names[:width], *[""] * (width - len(names)))
    return replace(
        table,
        header=header,
        body=whole,
        lines=lines[retained],
        rows_in_file=int(used.size),
        findings=tuple(findings),
        is_even=False,
    )


def _repaired(findings: list[Finding], what: str, words: str, **more: object) -> None:
    findings.append(Finding("repaired", what, words, **more))  # type: ignore[arg-type]


def _width(used: Positions, named: int) -> int:
    """Return how many cells a row is brought to: all that have names, or what most rows have."""
    within = used[used <= named]
    usual = int(np.bincount(used).argmax())
    return max(usual, int(within.max()) if within.size else 1)


def _report_widths(used: Positions, names: list[str], width: int, findings: list[Finding]) -> None:
    if width > len(names) + 1:
        findings.append(
            Finding(
                "left out", "cells without a name",
                f"rows hold up to {width} cells, the header names {len(names)} columns; the cells "
                f"beyond, as a script adds them, are left out", count=width - len(names),
            )
        )  # fmt: skip
    elif int(used.max()) < len(names):
        missing = names[width:]
        _repaired(
            findings, "ragged rows",
            f"the header names {len(names)} columns, no row holds more than {used.max()} cells; "
            f"{', '.join(missing[:12])} left out", count=len(missing),
        )  # fmt: skip


def _mended(
    body: bytes,
    starts: Positions,
    ends: Positions,
    blank: NDArray[np.bool_],
    irregular: Positions,
    width: int,
    delimiter: str,
    lines: Positions,
    cut_at_end: bool,
    findings: list[Finding],
) -> tuple[NDArray[np.bool_], bytes]:
    """Return which lines stay and the bytes of those that do."""
    mark = delimiter.encode()
    retained = ~blank
    short, long, blanks = [], [], []
    instead: dict[int, bytes] = {}
    last = len(ends) - 1
    for i in irregular.tolist():
        cells = body[starts[i] : ends[i]].split(mark)
        if not b"".join(cells).strip():
            retained[i] = False
            blanks.append(i)
        elif len(cells) < width:
            if cut_at_end and i == last:
                retained[i] = False
                continue
            short.append(i)
            instead[i] = mark.join(cells + [b""] * (width - len(cells))) + b"\n"
        elif any(cell.strip() for cell in cells[width:]):
            retained[i] = False
            long.append(i)
        else:
            instead[i] = mark.join(cells[:width]) + b"\n"
    if short:
        _repaired(
            findings, "ragged rows",
            f"{counted(len(short), 'row')} shorter than the others; the missing cells are blank",
            count=len(short), lines=line_ranges(lines[short]),
        )  # fmt: skip
    if long:
        findings.append(
            Finding(
                "refused", "ragged rows",
                f"{counted(len(long), 'row')} with more cells than columns: which cell is which is "
                f"not known", count=len(long), lines=line_ranges(lines[long]),
            )
        )  # fmt: skip
    if blanks:
        findings.append(
            Finding(
                "refused", "empty rows", f"{counted(len(blanks), 'row')} of blanks",
                count=len(blanks), lines=line_ranges(lines[blanks]),
            )
        )  # fmt: skip
    if cut_at_end and not retained[last] and not blank[last] and last not in (*long, *blanks):
        words = "the last line ends in the middle of the row"
        findings.append(Finding("refused", _CUT, words, count=1, lines=str(lines[last])))
    return retained, _joined(body, starts, ends, retained, instead)


def _joined(
    body: bytes,
    starts: Positions,
    ends: Positions,
    retained: NDArray[np.bool_],
    instead: dict[int, bytes],
) -> bytes:
    """Return the retained lines, whole stretches of untouched ones at once."""
    touched = ~retained
    touched[list(instead)] = True
    breaks = np.flatnonzero(touched)
    pieces, at = [], 0
    for i in breaks.tolist():
        if i > at:
            pieces.append(body[starts[at] : starts[i]])
        if i in instead:
            pieces.append(instead[i])
        at = i + 1
    if at < len(ends):
        pieces.append(body[starts[at] :])
    return b"".join(pieces)
