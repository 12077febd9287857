"""CSV header detection (title, comments and unit line) and cell splitting."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain

from benchtool.core.errors import FileFormatError
from benchtool.core.plural import pluralize
from benchtool.data.repairs.foreign_units import is_unit, parse_header_cell

BYTE_ORDER_MARK = b"\xef\xbb\xbf"

Repairs = list[tuple[str, str]]  # topic, the same for every file, and message
START_BYTES = 1 << 16  # the header is within this part of the file; assumed

_END = "end of the table"
_MARKS = (b"#", b"%", b"//")
_COMMENT = re.compile(rb"(?m)^(#+|%+|//+)([^\n]*)")
_NUMBER = re.compile(r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf)", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class HeaderLine:
    """Header line of a table.

    Attributes:
        text: with the units of the line below it.
        line: number of the line before the first row, from 1.
        end: byte offset of the first row.
    """

    text: str
    line: int
    end: int


def decode(text: bytes, what: str, repairs: Repairs) -> str:
    """Return decoded UTF-8, or Windows-1252 as a fallback; `what` names the text in the repair."""
    try:
        return text.decode("utf-8")
    except UnicodeDecodeError:
        repairs.append(("encoding", f"{what} is not UTF-8; read as Windows-1252"))
        return text.decode("cp1252", "replace")


def most_frequent_delimiter(line: str) -> str:
    """Return the most frequent delimiter of a line."""
    return max(",;\t", key=line.count)


def detect_delimiter(first: str, repairs: Repairs) -> str:
    """Return the delimiter of a header, with a repair if it is not a comma."""
    delimiter = most_frequent_delimiter(first)
    if delimiter != ",":
        repairs.append(("other delimiter", f"cells are separated by {delimiter!r}, not ','"))
    return delimiter


def normalise_rows(data: bytes, repairs: Repairs) -> bytes:
    """Return text with comments blanked and columns of blanks separated by tabs."""
    data = _without_comments(data, repairs)
    lines = _first_lines(data)
    cells = [line.split() for line, _ in lines[:2]]
    if (
        len(cells) < 2
        or len(cells[0]) < 2
        or any(re.search(r"[,;\t]", line) for line, _ in lines[:1])
    ):
        return data
    if len(cells[1]) != len(cells[0]) or not all(map(_NUMBER.fullmatch, cells[1])):
        return data
    repairs.append(("other delimiter", "cells are separated by blanks, not ','"))
    data = re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", data.removeprefix(BYTE_ORDER_MARK))
    return re.sub(rb"[ \t]+", b"\t", data)


def _without_comments(data: bytes, repairs: Repairs) -> bytes:
    """Return text with comments blanked, except one with the column names of the rows below."""
    if not any(b"\n" + mark in data for mark in _MARKS) and not data.removeprefix(
        BYTE_ORDER_MARK
    ).startswith(_MARKS):
        return data
    data = data.removeprefix(BYTE_ORDER_MARK)
    header = None
    uncommented = _COMMENT.sub(b"", data[:START_BYTES])
    first = next((line for line in uncommented.split(b"\n") if line.strip()), b"")
    cells = _cells(first)
    if cells and all(map(_NUMBER.fullmatch, cells)):
        start = data.find(first)
        above = [line for line in _COMMENT.finditer(data[:start]) if line[2].strip()]
        header = above[-1] if above and len(_cells(above[-1][2])) == len(cells) else None

    def blank(match: re.Match[bytes]) -> bytes:
        names_columns = header is not None and match.start() == header.start()
        return b" " * len(match[1]) + match[2] if names_columns else b""

    data, count = _COMMENT.subn(blank, data)
    if header is not None:
        message = "the columns are named in the comment above the rows"
        repairs.append(("header", message))
        count -= 1
    if count:
        repairs.append(("comments", f"{pluralize(count, 'line')} of comments left out"))
    return data


def _cells(line: bytes) -> list[str]:
    """Return the non-blank cells of a line, split at its delimiter or at blanks."""
    text = line.decode("utf-8", "replace")
    delimiter = most_frequent_delimiter(text)
    parts = text.split(delimiter) if delimiter in text else text.split()
    return [part.strip() for part in parts if part.strip()]


def _first_lines(data: bytes) -> list[tuple[str, int]]:
    """Return the first non-blank lines, each with its byte offset."""
    lines, offset = [], len(BYTE_ORDER_MARK) if data.startswith(BYTE_ORDER_MARK) else 0
    for line in data[offset:START_BYTES].split(b"\n"):
        if line.strip() and not line.lower().startswith(b"sep="):
            lines.append((line.decode("utf-8", "replace"), offset))
        offset += len(line) + 1
    return lines


def find_header(data: bytes, repairs: Repairs) -> HeaderLine:
    """Return the header line: the first, or the one below a title."""
    offset = len(BYTE_ORDER_MARK) if data.startswith(BYTE_ORDER_MARK) else 0
    if data[offset : offset + 4].lower() == b"sep=":
        repairs.append(("spreadsheet's line", "a first line 'sep=' was ignored"))
    lines = _first_lines(data)
    position = _below_titles([line for line, _ in lines])
    if position:
        message = f"{position} lines above the names of the columns were left out"
        repairs.append(("title", message))
    begin = lines[position][1] if lines else offset
    end = data.find(b"\n", begin)
    end = len(data) if end < 0 else end
    text = decode(data[begin:end], "the header", repairs)
    end = min(end + 1, len(data))
    line = data.count(b"\n", 0, begin) + 1
    if position + 1 < len(lines):
        below, start = lines[position + 1]
        if with_units := _with_units(text, below):
            repairs.append(("units", "units stand in the line below the names"))
            text = with_units
            end = data.find(b"\n", start) + 1 or len(data)
            line = data.count(b"\n", 0, start) + 1
    return HeaderLine(text, line, end)


def _below_titles(lines: Sequence[str]) -> int:
    """Return the index of the header line; titles have less than half as many cells."""
    counts = [len(_cells(line.encode())) for line in lines[:60]]
    for position in range(len(counts) - 1):
        following = lines[position + 1]
        numbers = sum(bool(_NUMBER.fullmatch(cell)) for cell in _cells(following.encode()))
        if 2 * numbers > counts[position + 1]:
            return position
        if '"' in lines[position] or 2 * counts[position] > max(counts[position + 1 :]):
            break
    else:
        return 0
    wide = any(most_frequent_delimiter(line) in line for line in lines[position : position + 1])
    return position if wide else 0


def _with_units(header: str, below: str) -> str:
    """Return a header with the units of the line below it; empty if that line has no units."""
    delimiter = most_frequent_delimiter(header)
    names, units = (
        header.split(delimiter),
        [cell.strip(" \r()[]") for cell in below.split(delimiter)],
    )
    present = [unit for unit in units if unit]
    if len(names) < 2 or len(units) > len(names) or len(present) < len(names) / 2:
        return ""
    if not all(map(is_unit, present)):
        return ""
    units += [""] * (len(names) - len(units))
    return delimiter.join(
        f"{name} [{unit}]" if unit and parse_header_cell(name).unit is None else name
        for name, unit in zip(names, units, strict=True)
    )


def split_cells(
    text: str, delimiter: str, where: str, first_line: int, *, whole: bool = True
) -> tuple[list[list[str]], list[int]]:
    """Return the cells of each row, and the line of the file in which it ends."""
    # An unclosed quote makes the end marker part of its cell.
    reader = csv.reader(chain(io.StringIO(text, newline=""), [_END]), delimiter=delimiter)
    rows: list[list[str]] = []
    lines = [0]
    open_line = 0
    try:
        for row in reader:
            rows.append(row)
            n_lines, per_line = reader.line_num - lines[-1], len(rows[0]) - 1
            if n_lines > 1 < per_line and not open_line:
                marks = len(row) - 1 + sum(cell.count(delimiter) for cell in row)
                open_line = lines[-1] + 1 if marks >= n_lines * per_line else 0
            lines.append(reader.line_num)
        if whole and rows[-1] != [_END]:
            open_line = open_line or lines[-2] + 1
    except csv.Error as error:
        line = first_line + reader.line_num - 1
        if reader.line_num == lines[-1] + 1:
            raise FileFormatError(where, f"line {line} cannot be read: {error}") from error
        open_line = open_line or lines[-1] + 1  # a cell of many rows is longer than csv allows
    if open_line:
        raise FileFormatError(
            f"{where}, line {first_line + open_line - 1}",
            "a quote that opens in this row contains the rows below it; close or delete the quote",
        )
    return rows[:-1], [first_line + line - 1 for line in lines[1:-1]]
