"""Tolerant CSV reader: byte order mark, semicolons, CRLF, incomplete last line.

`parse_csv` returns an array of text, for a fit; a row with too many cells is an error.
`parse_rows` returns the rows of a foreign file as bytes, so that a million rows are read quickly.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import FileFormatError
from benchtool.core.text import pluralize
from benchtool.core.user_file import (
    MAX_TABLE_BYTES,
    check_cells,
    check_columns,
    check_decoded,
    open_file,
    read_file,
)
from benchtool.data.csv_header import (
    BYTE_ORDER_MARK,
    START_BYTES,
    HeaderLine,
    Repairs,
    decode,
    find_header,
    most_frequent_delimiter,
    normalise_rows,
    split_cells,
)
from benchtool.data.repairs.import_result import Finding, Kind, line_ranges

Positions = NDArray[np.intp]

_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:\.\d{3})+(?:,\d+)?")  # 1.234,5

_CELL_WITH_COMMA = re.compile(rb"(?:^|[;\t])\s*[+-]?\d+,\d")
_PIECE_BYTES = 1 << 18

BLANK_CELLS = ("", "nan", "NaN", "NAN", "NA", "N/A", "n/a", "#N/A", "null", "None", "-")

UTF_16, PARQUET = (b"\xff\xfe", b"\xfe\xff"), b"PAR1"  # first bytes of files in these encodings


@dataclass(frozen=True, slots=True, eq=False)
class CsvTable:
    """Cells of a CSV file as text."""

    where: str
    header: tuple[str, ...]  # column names without surrounding blanks
    rows: NDArray[np.object_]  # (n, c) stripped text
    lines: Positions  # (n,) line of each row in the file, from 1
    repairs: tuple[str, ...]


def read_csv_text(path: Path, *, is_own: bool = False, follow: bool = True) -> CsvTable:
    """Return the cells of a CSV file, repaired where possible.

    If benchtool wrote it (`is_own`), a last line without line end is incomplete and dropped even if
    it looks complete.
    """
    return parse_csv(read_file(path, MAX_TABLE_BYTES, follow=follow), str(path), is_own=is_own)


def read_csv_header(path: Path) -> tuple[str, ...]:
    """Return the column names of a CSV file; only its first rows are read."""
    with open_file(path) as file:
        data = file.read(START_BYTES)
        if data[:2] in UTF_16 or data[:4] == PARQUET or b"\n" not in data:
            data += file.read(MAX_TABLE_BYTES)
        else:
            data = data[: data.rfind(b"\n") + 1]
    return parse_csv(data, str(path), whole=False).header


class _Tokens(NamedTuple):
    """Header and rows of a text."""

    names: list[str]
    delimiter: str
    body: memoryview  # below the header; a view of the file if it needed no repair
    rows: list[list[str]] | None  # cells of the body; None if it has no quotes
    lines: Positions  # of each row in the file, from 1
    is_cut: bool  # no line end after the last row
    repairs: Repairs


def _tokenize(
    data: bytes, where: str, *, cells: bool = False, own: bool = False, whole: bool = True
) -> _Tokens:
    """Return header and rows of a text; `own` and `whole` as in `read_csv_text` and `parse_csv`.

    `cells` splits also rows without quotes into cells, whose number is limited.
    """
    repairs: Repairs = []
    data = _decode_text(data, where, repairs)
    if cells:
        data = decode(data, "the text", repairs).encode()
    if own:
        end = data.find(b"\n") + 1 or len(data)
        header = HeaderLine(data[:end].decode().rstrip("\n"), 1, end)
    else:
        data = normalise_rows(data, repairs)
        header = find_header(data, repairs)
    delimiter = most_frequent_delimiter(header.text)
    if delimiter != ",":
        repairs.append(("other delimiter", f"cells are separated by {delimiter!r}, not ','"))
    names, body, rows = header.text.split(delimiter), memoryview(data)[header.end :], None
    check_columns(len(names), where)
    is_cut, ends = bytes(body[-1:]) != b"\n", count_character(body, "\n")
    lines = header.line + np.arange(1, ends + 1 + is_cut)
    if cells:
        check_cells(len(names) + count_character(body, delimiter) + ends, where)
    if cells or b'"' in data:
        text = f"{header.text}\n{str(body, 'utf-8', 'replace')}"
        rows, line_numbers = split_cells(text, delimiter, where, header.line, whole=whole)
        names, lines = rows.pop(0) if rows else [], np.array(line_numbers[1:], np.intp)
    names = [name.strip() for name in names]
    if not any(names):
        raise FileFormatError(where, "the first line names no columns; add a header line")
    return _Tokens(names, delimiter, body, rows, lines, is_cut, repairs)


def parse_csv(data: bytes, where: str, *, is_own: bool = False, whole: bool = True) -> CsvTable:
    """Return the cells of CSV bytes; see `read_csv_text`. If not `whole`, a quote may be open."""
    header, delimiter, _, rows, lines, is_cut, tokenizer_repairs = _tokenize(
        data, where, cells=True, own=is_own, whole=whole
    )
    repairs = [message for _, message in tokenizer_repairs]
    while not header[-1]:
        header.pop()
    width = len(header)
    numbered = zip(lines.tolist(), rows or (), strict=True)
    by_line = {line: row for line, row in numbered if any(map(str.strip, row))}
    if is_cut and by_line and (is_own or len(by_line[max(by_line)]) < width):
        by_line.popitem()
        repairs.append("the last line was cut short and left out")
    if short := [line for line, row in by_line.items() if len(row) < width]:
        repairs.append(f"{len(short)} rows shorter than the header, first in line {short[0]}")
    for line, row in by_line.items():
        if any(map(str.strip, row[width:])):
            raise FileFormatError(
                where,
                f"line {line} has {len(row)} cells, the header names {width} columns; correct the "
                f"line or the header",
            )
    cells = np.full((len(by_line), width), "", object)
    for target, texts in zip(cells, by_line.values(), strict=True):
        target[: len(texts)] = [text.strip() for text in texts[:width]]
    if delimiter == ";":
        repairs += _with_points(cells.ravel())
    return CsvTable(where, tuple(header), cells, np.array([*by_line], np.intp), tuple(repairs))


def _with_points(cells: NDArray[np.object_]) -> list[str]:
    """Replace decimal commas by points, remove points between thousands, return the repairs."""
    commas = [i for i, cell in enumerate(cells) if _DECIMAL_COMMA.fullmatch(cell)]
    if not commas:
        return []
    thousands = [i for i, cell in enumerate(cells) if THOUSANDS.fullmatch(cell)]
    for i in (*commas, *thousands):
        cells[i] = cells[i].replace(".", "").replace(",", ".")
    done = [f"{len(commas)} decimal commas read as points"]
    if thousands:
        done.append(f"{pluralize(len(thousands), 'number')} with points between thousands")
    return done


def _decode_text(data: bytes, where: str, repairs: Repairs) -> bytes:
    """Return the bytes of a text with line ends LF; UTF-16 as UTF-8, Parquet as CSV text."""
    if data[:2] in UTF_16:
        data = data.decode("utf-16", "replace").encode()
        repairs.append(("UTF-16", "the text is UTF-16, as Excel saves it; read as UTF-8"))
    if data.startswith(BYTE_ORDER_MARK):
        data = data.removeprefix(BYTE_ORDER_MARK)
        repairs.append(("byte order mark", "a byte order mark at the start was left out"))
    if data.startswith(PARQUET):
        data = _text_of_parquet(data, where)
    if not data or data.isspace():
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
    """Rows of a text file as bytes, all of one width."""

    where: str
    header: tuple[str, ...]  # without surrounding blanks; "" for a column without a name
    body: bytes | memoryview  # each row ended by a newline; a view of the file if nothing changed
    lines: Positions  # of each row in the file, from 1
    delimiter: str
    decimal: str  # "." or ","
    rows_in_file: int  # non-blank lines below the header
    findings: tuple[Finding, ...]
    is_even: bool  # by the count of delimiters, rows are as wide as the header; see `pad_rows`


def parse_rows(data: bytes, where: str) -> TextTable:
    """Return the rows of CSV bytes."""
    names, delimiter, body, rows, lines, is_cut, repairs = _tokenize(data, where)
    text: bytes | memoryview = body
    if rows is not None:
        # A delimiter or line end in quotes becomes a blank, as numbers contain neither.
        blanks = str.maketrans(f"{delimiter}\n", "  ")
        names = [name.translate(blanks).strip() for name in names]
        texts = [delimiter.join(cell.translate(blanks) for cell in row) for row in rows]
        text = "".join(f"{row}\n" for row in texts).encode()
        if is_cut and texts and texts[-1]:
            text = text[:-1]
    decimal = "."
    if delimiter != "," and _CELL_WITH_COMMA.search(bytes(text[:START_BYTES])):
        decimal = ","
        repairs.append(("decimal commas", "decimal commas are read as points"))
    ends = len(lines) - (text[-1:] != b"\n")
    table = TextTable(
        where=where,
        header=tuple(names),
        body=text,
        lines=lines,
        delimiter=delimiter,
        decimal=decimal,
        rows_in_file=ends,
        findings=tuple(Finding("repaired", what, message) for what, message in repairs),
        # A short row and a long row can cancel in this count; `parse_numbers` detects that.
        is_even=text[-1:] == b"\n" and count_character(text, delimiter) == (len(names) - 1) * ends,
    )
    return table if table.is_even else pad_rows(table)


def count_character(body: bytes | memoryview, letter: str) -> int:
    """Return how often a character occurs in the rows, counted in blocks that fit a cache."""
    text, code = np.frombuffer(body, np.uint8), ord(letter)
    pieces = range(0, text.size, _PIECE_BYTES)
    return sum(
        int(np.count_nonzero(text[start : start + _PIECE_BYTES] == code)) for start in pieces
    )


def pad_rows(table: TextTable) -> TextTable:
    """Return the table with rows of one width, and findings about the repairs."""
    mark, names, findings = table.delimiter.encode(), list(table.header), list(table.findings)

    def note(kind: Kind, what: str, irregular: list[int], problem: str) -> None:
        if count := len(irregular):
            message, lines = f"{pluralize(count, 'row')} {problem}", table.lines[irregular]
            findings.append(Finding(kind, what, message, "", count, line_ranges(lines)))

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
    width = len(table.header)
    if not table.is_even:  # the most frequent width, at least the widest within the header
        within = used[used <= len(names)]
        width = max(int(np.bincount(used).argmax()), int(within.max(initial=1)))
    short, long, blank, is_cut = list[int](), list[int](), list[int](), False
    for i in np.flatnonzero(keep & (counts != width)).tolist():
        cells = rows[i].split(mark)
        keep[i] = False
        if not b"".join(cells).strip():
            blank.append(i)
        elif any(cell.strip() for cell in cells[width:]):
            long.append(i)
        elif len(cells) < width and i == last:
            is_cut = True
        else:
            keep[i] = True
            rows[i] = mark.join(cells[:width] + [b""] * (width - len(cells)))
            short += [i] if len(cells) < width else []
    note("repaired", "ragged rows", short, "shorter than the others; the missing cells are blank")
    note("refused", "ragged rows", long, "with more cells than columns: columns are ambiguous")
    note("refused", "empty rows", blank, "of blanks")
    last_line = line_ranges(table.lines[[last]])
    if is_cut:
        message = "the last line ends in the middle of the row"
        findings.append(Finding("refused", "the last line was cut", message, "", 1, last_line))
    elif last >= 0 and keep[last]:
        message = "the file ends without a line end; its last number may be cut"
        findings.append(Finding("doubt", "no last line end", message, lines=last_line))
    if separators:
        message = f"{pluralize(separators, 'row')} of empty cells left out"
        findings.append(Finding("repaired", "empty rows", message, count=separators))
    if (extra := width - len(names)) > 1:
        message = (
            f"rows have up to {width} cells, the header names {len(names)} columns; the extra "
            f"cells are left out"
        )
        findings.append(Finding("left out", "cells without a name", message, count=extra))
    elif int(used.max()) < len(names):
        message = (
            f"the header names {len(names)} columns, no row has more than {used.max()} cells; "
            f"{', '.join(names[width:][:12])} left out"
        )
        findings.append(Finding("repaired", "ragged rows", message, count=-extra))
    return replace(
        table,
        header=(*names[:width], *[""] * extra),
        body=b"".join(row + b"\n" for row in compress(rows, keep)),
        lines=table.lines[keep],
        rows_in_file=int(used.size),
        findings=tuple(findings),
        is_even=False,
    )
