"""Lay out the rows of foreign CSV bytes: every line kept, mended with words, or refused.

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

from benchtool.core.errors import FileFormatError
from benchtool.core.table_bounds import check_columns
from benchtool.data.repairs.even_rows import evened
from benchtool.data.repairs.imported import Finding

Positions = NDArray[np.intp]

_DECIMAL_COMMA = re.compile(rb"(?:^|[;\t])\s*[+-]?\d+,\d")
_START_BYTES = 1 << 16
_PIECE_BYTES = 1 << 18
_MARK = b"\xef\xbb\xbf"


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
    findings: list[Finding] = []
    data = _as_plain_text(data, where, findings)
    first, header_line, rest_at = _header_line(data, where, findings)
    delimiter = max(",;\t", key=first.count)
    if delimiter != ",":
        _repaired(findings, "other delimiter", f"cells are separated by {delimiter!r}, not ','")
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
        _repaired(findings, "decimal commas", "decimal commas are read as points")
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
        findings=tuple(findings),
        is_even=False,
    )
    return replace(table, is_even=True) if _looks_even(table) else evened(table)


def _repaired(findings: list[Finding], what: str, words: str, **more: object) -> None:
    findings.append(Finding("repaired", what, words, **more))  # type: ignore[arg-type]


def _as_plain_text(data: bytes, where: str, findings: list[Finding]) -> bytes:
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        data = data.decode("utf-16", "replace").encode()
        _repaired(findings, "UTF-16", "the text is UTF-16, as Excel saves it; read as UTF-8")
    if data.startswith(_MARK):
        _repaired(findings, "byte order mark", "a byte order mark at the start was left out")
    if not data[: 1 << 16].removeprefix(_MARK).strip() and not data.removeprefix(_MARK).strip():
        raise FileFormatError(where, "the file is empty; name a file with a header line and rows")
    if b"\0" in data[:4096]:
        raise FileFormatError(where, "this is not a text file; name a CSV file or a flight log")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n")
        data = data.replace(b"\r", b" " if b"\n" in data else b"\n")
        _repaired(findings, "line ends", "line ends CRLF or CR are read as LF")
    return data


def _header_line(data: bytes, where: str, findings: list[Finding]) -> tuple[str, int, int]:
    """Return the header as text, its line number, and where the rows begin."""
    at, line = len(_MARK) if data.startswith(_MARK) else 0, 0
    while at < len(data):
        end = data.find(b"\n", at)
        end = len(data) if end < 0 else end
        line += 1
        raw, at = data[at:end], end + 1
        if raw.lower().startswith(b"sep="):
            _repaired(findings, "spreadsheet's line", "a first line 'sep=' was left out")
        elif raw.strip():
            break
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError:
        text = raw.decode("cp1252", "replace")
        _repaired(findings, "encoding", "the header is not UTF-8; read as Windows-1252")
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
