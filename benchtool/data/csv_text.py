"""Read CSV text as people's programs leave it: BOM, semicolons, CRLF, a cut last line."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from benchtool.core.errors import FileFormatError
from benchtool.core.table_bounds import MOST_TABLE_BYTES, check_cells, check_columns
from benchtool.core.user_file import read_file

BYTE_ORDER_MARK = b"\xef\xbb\xbf"

Repairs = list[tuple[str, str]]
"""What was mended in a text: the matter, the same for every file, and a sentence."""

_DECIMAL_COMMA = re.compile(r"[+-]?\d+,\d+(?:[eE][+-]?\d+)?")


@dataclass(frozen=True, slots=True, eq=False)
class CsvTable:
    """Hold the cells of a CSV file as text.

    Attributes:
        where: the file's path as given.
        header: column names without surrounding blanks.
        rows: cells, as many as the header in every row.
        lines: line number of each row in the file, from 1.
        repairs: what had to be mended, in words.
    """

    where: str
    header: tuple[str, ...]
    rows: list[list[str]]
    lines: list[int]
    repairs: tuple[str, ...]


def read_csv_text(path: Path, *, own: bool = False, follow: bool = True) -> CsvTable:
    """Return the cells of a CSV file, mended with words or refused with words.

    Args:
        path: the file.
        own: the file is one of ours: a last line without its line end was cut by a kill and is
            left out, even when it looks whole.
        follow: whether a symbolic link in place of the file is followed.
    """
    return parse_csv(read_file(path, MOST_TABLE_BYTES, follow=follow), str(path), own=own)


def no_rows(where: str, header: Sequence[str]) -> FileFormatError:
    """Return the refusal of a file without a row below its first line."""
    if len(header) > 1:
        return FileFormatError(where, "there is a header but no row below it; add data")
    return FileFormatError(
        where,
        f"it holds {header[0][:40]!r} and no row below it; a CSV has a line with the names of "
        f"columns, and rows of numbers below",
    )


def parse_csv(data: bytes, where: str, *, own: bool = False) -> CsvTable:
    """Return the cells of CSV bytes; see `read_csv_text`."""
    mended: Repairs = []
    data = plain_text(data, where, mended)
    text = decode(data.removeprefix(BYTE_ORDER_MARK), "the text", mended)
    cut = bool(text) and not text.endswith("\n")
    first = text.split("\n", 1)[0]
    delimiter = delimiter_of(first, mended)
    repairs = [words for _, words in mended]
    check_columns(first.count(delimiter) + 1, where)
    check_cells(text.count(delimiter) + text.count("\n"), where)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
    try:
        header = [cell.strip() for cell in next(reader, [])]
        numbered = [(row, reader.line_num) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        problem = f"line {reader.line_num} cannot be read: {error}; mend that line"
        raise FileFormatError(where, problem) from error
    while header and not header[-1]:
        header.pop()
    if not header:
        raise FileFormatError(where, "the first line names no columns; add a header line")
    width = len(header)
    if cut and numbered and (own or len(numbered[-1][0]) < width):
        numbered.pop()
        repairs.append("the last line was cut short and left out")
    short = [line for row, line in numbered if len(row) < width]
    if short:
        repairs.append(f"{len(short)} rows shorter than the header, first in line {short[0]}")
    for row, line in numbered:
        if any(cell.strip() for cell in row[width:]):
            raise FileFormatError(
                where,
                f"line {line} has {len(row)} cells, the header names {width} columns; mend the "
                f"line or the header",
            )
    rows = [_fit(row, width) for row, _ in numbered]
    if delimiter == ";":
        _point_decimals(rows, repairs)
    return CsvTable(where, tuple(header), rows, [line for _, line in numbered], tuple(repairs))


def plain_text(data: bytes, where: str, repairs: Repairs) -> bytes:
    """Return the bytes of a text with line ends LF, in the encoding that it has beside UTF-16.

    A byte order mark stays where it is: a long file is not copied for three bytes.

    Raises:
        FileFormatError: nothing in it, or no text.
    """
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        data = data.decode("utf-16", "replace").encode()
        repairs.append(("UTF-16", "the text is UTF-16, as Excel saves it; read as UTF-8"))
    if data.startswith(BYTE_ORDER_MARK):
        repairs.append(("byte order mark", "a byte order mark at the start was left out"))
    begin = data[: 1 << 16].removeprefix(BYTE_ORDER_MARK)
    if not begin.strip() and not data.removeprefix(BYTE_ORDER_MARK).strip():
        raise FileFormatError(where, "the file is empty; name a file with a header line and rows")
    if b"\0" in data[:4096]:
        raise FileFormatError(where, "this is not a text file; name a CSV file or a flight log")
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n")
        data = data.replace(b"\r", b" " if b"\n" in data else b"\n")
        repairs.append(("line ends", "line ends CRLF or CR are read as LF"))
    return data


def decode(text: bytes, what: str, repairs: Repairs) -> str:
    """Return UTF-8 as text, or what spreadsheets write in its place; `what` names it."""
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        repairs.append(("encoding", f"{what} is not UTF-8; read as Windows-1252"))
        return text.decode("cp1252", "replace")


def delimiter_of(first: str, repairs: Repairs) -> str:
    """Return what separates the cells of a first line."""
    delimiter = max(",;\t", key=first.count)
    if delimiter != ",":
        repairs.append(("other delimiter", f"cells are separated by {delimiter!r}, not ','"))
    return delimiter


def _fit(row: list[str], width: int) -> list[str]:
    return row[:width] + [""] * (width - len(row))


def _point_decimals(rows: list[list[str]], repairs: list[str]) -> None:
    changed = 0
    for row in rows:
        for index, cell in enumerate(row):
            if _DECIMAL_COMMA.fullmatch(cell.strip()):
                row[index] = cell.strip().replace(",", ".")
                changed += 1
    if changed:
        repairs.append(f"{changed} decimal commas read as points")
