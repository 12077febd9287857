"""Tolerant CSV reader: byte order mark, semicolons, CRLF, incomplete last line.

`read_csv_text` returns cells as text, for a fit; a row with too many cells is an error.
`parse_rows` returns the rows of a foreign file as bytes, so that a million rows are read quickly.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import FileFormatError
from benchtool.core.plural import pluralize
from benchtool.core.table_bounds import MAX_TABLE_BYTES, check_cells, check_columns, check_decoded
from benchtool.core.user_file import read_file
from benchtool.data.csv_header import (
    BYTE_ORDER_MARK,
    START_BYTES,
    HeaderLine,
    Repairs,
    decode,
    detect_delimiter,
    find_header,
    normalise_rows,
    split_cells,
)
from benchtool.data.repairs.import_result import Finding, Kind, line_ranges

Positions = NDArray[np.intp]

_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:\.\d{3})+(?:,\d+)?")  # 1.234,5

_CELL_WITH_COMMA = re.compile(rb"(?:^|[;\t])\s*[+-]?\d+,\d")
_PIECE_BYTES = 1 << 18

UTF_16, PARQUET = (b"\xff\xfe", b"\xfe\xff"), b"PAR1"  # first bytes of files in these encodings


@dataclass(frozen=True, slots=True, eq=False)
class CsvTable:
    """Cells of a CSV file as text.

    Attributes:
        header: column names without surrounding blanks.
        rows: cells, as many as the header in every row.
        lines: line number of each row in the file, from 1.
    """

    where: str
    header: tuple[str, ...]
    rows: list[list[str]]
    lines: list[int]
    repairs: tuple[str, ...]


def read_csv_text(path: Path, *, own: bool = False, follow: bool = True) -> CsvTable:
    """Return the cells of a CSV file, repaired where possible.

    Args:
        own: written by benchtool: a last line without line end is incomplete and dropped, even if
            it looks complete.
        follow: follow a symbolic link.
    """
    return parse_csv(read_file(path, MAX_TABLE_BYTES, follow=follow), str(path), own=own)


def read_csv_header(path: Path) -> tuple[str, ...]:
    """Return the column names of a CSV file; only its first rows are read."""
    data = read_file(path, MAX_TABLE_BYTES)
    if data[:2] not in UTF_16 and data[:4] != PARQUET:
        data = data[: data.rfind(b"\n", 0, START_BYTES) + 1] or data
    return parse_csv(data, str(path), whole=False).header


def parse_csv(data: bytes, where: str, *, own: bool = False, whole: bool = True) -> CsvTable:
    """Return the cells of CSV bytes; see `read_csv_text`. If not `whole`, a quote may be open."""
    repair_messages: Repairs = []
    data = decode_text(data, where, repair_messages)
    text, first_line = decode(data.removeprefix(BYTE_ORDER_MARK), "the text", repair_messages), 1
    first = text.split("\n", 1)[0]
    if not own:
        data = normalise_rows(text.encode(), repair_messages)
        header_line = find_header(data, repair_messages)
        first, first_line = header_line.text, header_line.line
        body = data[header_line.end :].decode()
        text = f"{first}\n{body}" if body or data.endswith(b"\n") else first
    delimiter = detect_delimiter(first, repair_messages)
    repairs = [message for _, message in repair_messages]
    check_columns(first.count(delimiter) + 1, where)
    check_cells(text.count(delimiter) + text.count("\n"), where)
    rows, lines = split_cells(text, delimiter, where, first_line, whole=whole)
    header = [cell.strip() for cell in rows[0]]
    while header and not header[-1]:
        header.pop()
    if not header:
        raise FileFormatError(where, "the first line names no columns; add a header line")
    width = len(header)
    numbered = [
        pair for pair in zip(rows[1:], lines[1:], strict=True) if any(map(str.strip, pair[0]))
    ]
    if numbered and not text.endswith("\n") and (own or len(numbered[-1][0]) < width):
        numbered.pop()
        repairs.append("the last line was cut short and left out")
    short = [line for row, line in numbered if len(row) < width]
    if short:
        repairs.append(f"{len(short)} rows shorter than the header, first in line {short[0]}")
    for row, line in numbered:
        if any(map(str.strip, row[width:])):
            raise FileFormatError(
                where,
                f"line {line} has {len(row)} cells, the header names {width} columns; correct the "
                f"line or the header",
            )
    cells = [
        row if len(row) == width else row[:width] + [""] * (width - len(row)) for row, _ in numbered
    ]
    if delimiter == ";":
        repairs += _with_points(cells)
    return CsvTable(where, tuple(header), cells, [line for _, line in numbered], tuple(repairs))


def _with_points(rows: list[list[str]]) -> list[str]:
    """Replace decimal commas by points, remove points between thousands, return the repairs."""
    cells = [(row, index) for row in rows for index in range(len(row))]
    commas = [(row, i) for row, i in cells if _DECIMAL_COMMA.fullmatch(row[i].strip())]
    if not commas:
        return []
    thousands = [(row, i) for row, i in cells if THOUSANDS.fullmatch(row[i].strip())]
    for row, i in (*commas, *thousands):
        row[i] = row[i].strip().replace(".", "").replace(",", ".")
    done = [f"{len(commas)} decimal commas read as points"]
    if thousands:
        done.append(f"{pluralize(len(thousands), 'number')} with points between thousands")
    return done


def decode_text(data: bytes, where: str, repairs: Repairs) -> bytes:
    """Return the bytes of a text with line ends LF; UTF-16 as UTF-8, Parquet as CSV text.

    A byte order mark remains, to avoid a copy of a long file.

    Raises:
        FileFormatError: the file is empty or not text.
    """
    if data[:2] in UTF_16:
        data = data.decode("utf-16", "replace").encode()
        repairs.append(("UTF-16", "the text is UTF-16, as Excel saves it; read as UTF-8"))
    if data.startswith(BYTE_ORDER_MARK):
        repairs.append(("byte order mark", "a byte order mark at the start was left out"))
    if data.startswith(PARQUET):
        data = _text_of_parquet(data, where)
    begin = data[:START_BYTES].removeprefix(BYTE_ORDER_MARK)
    if not begin.strip() and not data.removeprefix(BYTE_ORDER_MARK).strip():
        raise FileFormatError(where, "the file is empty; name a file with a header line and rows")
    if b"\0" in data[:4096]:
        raise FileFormatError(where, "this is not a text file; name a CSV file or a flight log")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n")
        data = data.replace(b"\r", b" " if b"\n" in data else b"\n")
        repairs.append(("line ends", "line ends CRLF or CR are read as LF"))
    return data


def _text_of_parquet(data: bytes, where: str) -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as pq
    from pyarrow import csv

    text = io.BytesIO()
    try:
        with pq.ParquetFile(pa.BufferReader(data)) as file:
            check_columns(len(file.schema_arrow.names), where)
            check_decoded(file.metadata.num_rows, len(file.schema_arrow.names), where)
            csv.write_csv(file.read(use_threads=False), text)
    except (pa.ArrowException, OSError) as error:
        problem = " ".join(str(error).split())[:200]
        raise FileFormatError(
            where, f"it cannot be read as a Parquet table of numbers and text ({problem})"
        ) from error
    return text.getvalue()


def empty_table_error(where: str, header: Sequence[str]) -> FileFormatError:
    """Return the error for a file without a row below its first line."""
    if len(header) > 1:
        return FileFormatError(where, "there is a header but no row below it; add data")
    return FileFormatError(
        where,
        f"it contains {header[0][:40]!r} and no row below; a CSV needs a line of column names and "
        f"rows of numbers",
    )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TextTable:
    """Rows of a text file as bytes, all of one width.

    Attributes:
        header: (w,) column names without surrounding blanks; "" for a column without a name.
        body: rows of w cells, each ended by a newline; a view of the file if all had w cells.
        lines: (n,) line number of each row in the file, from 1.
        decimal: "." or ",".
        rows_in_file: non-blank lines below the header.
        is_even: by the count of delimiters, every row is as wide as the header; see `pad_rows`.
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


def parse_rows(data: bytes, where: str) -> TextTable:
    """Return the rows of CSV bytes.

    Raises:
        FileFormatError: no text, no header, or no row below it.
    """
    repairs: Repairs = []
    data = decode_text(data, where, repairs)
    data = normalise_rows(data, repairs)
    header = find_header(data, repairs)
    first, rest_at = header.text, header.end
    delimiter = detect_delimiter(first, repairs)
    body: bytes | memoryview = memoryview(data)[rest_at:]
    line_numbers = None
    if b'"' in data:
        first, body, line_numbers = _parse_quoted(header, data[rest_at:], delimiter, where)
    check_columns(first.count(delimiter) + 1, where)
    names = tuple(cell.strip() for cell in first.split(delimiter))
    if not any(names):
        raise FileFormatError(where, "the first line names no columns; add a header line")
    decimal = "."
    if delimiter != "," and _CELL_WITH_COMMA.search(bytes(body[:START_BYTES])):
        decimal = ","
        repairs.append(("decimal commas", "decimal commas are read as points"))
    rows = _count(body, "\n")
    if line_numbers is None:
        line_numbers = np.arange(1, rows + 1 + (body[-1:] != b"\n"))
    table = TextTable(
        where=where,
        header=names,
        body=body,
        lines=header.line + line_numbers,
        delimiter=delimiter,
        decimal=decimal,
        rows_in_file=rows,
        findings=tuple(Finding("repaired", what, message) for what, message in repairs),
        is_even=False,
    )
    # A short row and a long row can cancel in this count; `parse_numbers` detects that.
    if body[-1:] == b"\n" and _count(body, delimiter) == (len(names) - 1) * rows:
        return replace(table, is_even=True)
    return pad_rows(table)


def _parse_quoted(
    header: HeaderLine, body: bytes, delimiter: str, where: str
) -> tuple[str, bytes, Positions]:
    """Return header and rows without quotes, and the line of each row, counted from the header's.

    A delimiter or line end within quotes becomes a blank, as numbers contain neither.
    """
    clean = str.maketrans({delimiter: " ", "\n": " "})
    text = f"{header.text}\n{body.decode('utf-8', 'replace')}"
    cells, lines = split_cells(text, delimiter, where, header.line)
    rows = [delimiter.join(cell.translate(clean) for cell in row) for row in cells]
    body_text = "".join(f"{row}\n" for row in rows[1:])
    if not body.endswith(b"\n") and rows[-1]:
        body_text = body_text[:-1]
    return rows[0], body_text.encode(), np.array(lines[1:], np.intp) - header.line


def _count(body: bytes | memoryview, letter: str) -> int:
    """Return how often a character occurs in the rows, counted in blocks that fit a cache."""
    text, code = np.frombuffer(body, np.uint8), ord(letter)
    pieces = range(0, text.size, _PIECE_BYTES)
    return sum(
        int(np.count_nonzero(text[start : start + _PIECE_BYTES] == code)) for start in pieces
    )


def pad_rows(table: TextTable) -> TextTable:
    """Return the table with rows of one width, and findings about the repairs."""
    mark, names, findings = table.delimiter.encode(), list(table.header), list(table.findings)

    def note(kind: Kind, what: str, message: str, count: int, rows: Sequence[int] = ()) -> None:
        ranges = line_ranges(table.lines[list(rows)]) if rows else ""
        findings.append(Finding(kind, what, message, count=count, lines=ranges))

    rows = bytes(table.body).split(b"\n")
    last = len(rows) - 1 if rows[-1] else -1  # the row that the end of the file cuts
    if last < 0:
        rows.pop()
    counts = np.array([row.count(mark) + 1 for row in rows], np.intp)
    keep = np.array([bool(row.strip(mark)) for row in rows], bool)
    used = counts[keep]
    if not used.size:
        raise empty_table_error(table.where, table.header)
    separators = int(np.count_nonzero(~keep & (counts > 1)))
    while len(names) > 1 and not names[-1]:
        names.pop()
    # The caller of an even table has mapped its columns already.
    width = len(table.header) if table.is_even else _width(used, len(names))
    short, long, blank = [], [], []
    for i in np.flatnonzero(keep & (counts != width)).tolist():
        cells = rows[i].split(mark)
        keep[i] = False
        if not b"".join(cells).strip():
            blank.append(i)
        elif any(cell.strip() for cell in cells[width:]):
            long.append(i)
        elif len(cells) >= width or i != last:
            keep[i] = True
            rows[i] = mark.join(cells[:width] + [b""] * (width - len(cells)))
            short += [i] if len(cells) < width else []
    if short:
        message = (
            f"{pluralize(len(short), 'row')} shorter than the others; the missing cells are blank"
        )
        note("repaired", "ragged rows", message, len(short), short)
    if long:
        row_count = pluralize(len(long), "row")
        message = f"{row_count} with more cells than columns: columns are ambiguous"
        note("refused", "ragged rows", message, len(long), long)
    if blank:
        note(
            "refused", "empty rows", f"{pluralize(len(blank), 'row')} of blanks", len(blank), blank
        )
    if last >= 0 and keep[last]:
        message = "the file ends without a line end; its last number may be cut"
        note("doubt", "no last line end", message, 0, [last])
    elif last >= 0 and rows[last].strip(mark) and last not in (*long, *blank):
        message = "the last line ends in the middle of the row"
        note("refused", "the last line was cut", message, 1, [last])
    if separators:
        message = f"{pluralize(separators, 'row')} of empty cells left out"
        note("repaired", "empty rows", message, separators)
    if width > len(names) + 1:
        message = (
            f"rows have up to {width} cells, the header names {len(names)} columns; the extra "
            f"cells are left out"
        )
        note("left out", "cells without a name", message, width - len(names))
    elif int(used.max()) < len(names):
        message = (
            f"the header names {len(names)} columns, no row has more than {used.max()} cells; "
            f"{', '.join(names[width:][:12])} left out"
        )
        note("repaired", "ragged rows", message, len(names) - width)
    chosen = [row for row, is_selected in zip(rows, keep.tolist(), strict=True) if is_selected]
    return replace(
        table,
        header=(*names[:width], *[""] * (width - len(names))),
        body=b"\n".join(chosen) + b"\n" if chosen else b"",
        lines=table.lines[keep],
        rows_in_file=int(used.size),
        findings=tuple(findings),
        is_even=False,
    )


def _width(used: Positions, n_names: int) -> int:
    """Return the row width: the most frequent, at least the widest within the header."""
    within = used[used <= n_names]
    usual = int(np.bincount(used).argmax())
    return max(usual, int(within.max()) if within.size else 1)
