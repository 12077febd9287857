"""CSV header detection (title, comments and unit line) and cell splitting."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Collection, Sequence
from itertools import chain, zip_longest
from typing import NamedTuple

from benchtool.core.errors import FileFormatError
from benchtool.core.text import pluralize
from benchtool.data.column_map import is_unit, parse_header_cell

BYTE_ORDER_MARK = b"\xef\xbb\xbf"

Repairs = list[tuple[str, str]]  # topic, the same for every file, and message
START_BYTES = 1 << 16  # the header is within this part of the file; assumed

_END = "end of the table"
_MARKS = (b"#", b"%", b"//")
_COMMENT = re.compile(rb"(?m)^(#+(?!N/A\b)|%+|//+)([^\n]*)")  # `#N/A` is an empty cell
_NUMBER = re.compile(
    r"[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?|[+-]?(nan|inf)|#?n/a", re.IGNORECASE
)


class HeaderLine(NamedTuple):
    """Header line of a table."""

    text: str  # with the units of the line below it
    line: int  # number of the line before the first row, from 1
    end: int  # byte offset of the first row


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


def normalise_rows(data: bytes, repairs: Repairs) -> bytes:
    """Return text with comments blanked and columns of blanks separated by tabs."""
    data = _without_comments(data, repairs)
    lines = _first_lines(data)
    cells = [line.split() for line, _ in lines[:2]]
    if len(cells) < 2 or len(cells[0]) < 2 or re.search(r"[,;\t]", lines[0][0]):
        return data
    if len(cells[1]) != len(cells[0]) or not all(map(_NUMBER.fullmatch, cells[1])):
        return data
    repairs.append(("other delimiter", "cells are separated by blanks, not ','"))
    data = re.sub(rb"(?m)^[ \t]+|[ \t]+$", b"", data)
    return re.sub(rb"[ \t]+", b"\t", data)


def _without_comments(data: bytes, repairs: Repairs) -> bytes:
    """Return text with comments blanked, except one with the column names of the rows below."""
    if not data.startswith(_MARKS) and not any(_has_comment(data, mark) for mark in _MARKS):
        return data
    header = None
    uncommented = _COMMENT.sub(b"", data[:START_BYTES])
    first = next((line for line in uncommented.split(b"\n") if line.strip()), b"")
    cells = _cells(first.decode("utf-8", "replace"))
    if cells and all(map(_NUMBER.fullmatch, cells)):
        start = data.find(first)
        above = [line for line in _COMMENT.finditer(data[:start]) if line[2].strip()]
        if above and len(_cells(above[-1][2].decode("utf-8", "replace"))) == len(cells):
            header = above[-1]

    def blank(match: re.Match[bytes]) -> bytes:
        names_columns = header is not None and match.start() == header.start()
        return b" " * len(match[1]) + match[2] if names_columns else b""

    data, count = _COMMENT.subn(blank, data)
    if header is not None:
        repairs.append(("header", "the columns are named in the comment above the rows"))
        count -= 1
    if count:
        repairs.append(("comments", f"{pluralize(count, 'line')} of comments left out"))
    return data


def _has_comment(data: bytes, mark: bytes) -> bool:
    """Return whether a line below the first begins with a mark."""
    # A search for one byte takes a tenth of the time; headers have "%" and "/" in their units.
    start = data.find(mark[:1], START_BYTES)
    end = len(data) if start >= 0 else START_BYTES + len(mark)
    return data.find(b"\n" + mark, 0, end) >= 0


def _cells(text: str) -> list[str]:
    """Return the non-blank cells of a line, split at its delimiter or at blanks."""
    delimiter = most_frequent_delimiter(text)
    parts = text.split(delimiter) if delimiter in text else text.split()
    return [part.strip() for part in parts if part.strip()]


def _first_lines(data: bytes) -> list[tuple[str, int]]:
    """Return the first non-blank lines, each with its byte offset."""
    lines, offset = [], 0
    for line in data[:START_BYTES].split(b"\n"):
        if line.strip() and not line.lower().startswith(b"sep="):
            lines.append((line.decode("utf-8", "replace"), offset))
        offset += len(line) + 1
    return lines


def find_header(data: bytes, repairs: Repairs) -> HeaderLine:
    """Return the header line: the first, or the one below a title."""
    if data[:4].lower() == b"sep=":
        repairs.append(("spreadsheet's line", "a first line 'sep=' was ignored"))
    lines = _first_lines(data)
    position = _below_titles([line for line, _ in lines])
    if position:
        repairs.append(("title", f"{position} lines above the names of the columns were left out"))
    begin = lines[position][1] if lines else 0
    end = data.find(b"\n", begin) + 1 or len(data)
    text = decode(data[begin:end], "the header", repairs).removesuffix("\n")
    if position + 1 < len(lines) and (with_units := _with_units(text, lines[position + 1][0])):
        repairs.append(("units", "units are in the line below the names"))
        text, begin = with_units, lines[position + 1][1]
        end = data.find(b"\n", begin) + 1 or len(data)
    return HeaderLine(text, data.count(b"\n", 0, begin) + 1, end)


def _below_titles(lines: Sequence[str]) -> int:
    """Return the index of the header line below title lines, which have fewer cells."""
    cells = [_cells(line) for line in lines[:60]]
    for position, following in enumerate(cells[1:]):
        line = lines[position]
        if 2 * sum(bool(_NUMBER.fullmatch(cell)) for cell in following) > len(following):
            return position
        if '"' in line or 2 * len(cells[position]) > max(map(len, cells[position + 1 :])):
            return position if most_frequent_delimiter(line) in line else 0
    return 0


def _with_units(header: str, below: str) -> str:
    """Return a header with the units of the line below it; empty if that line has no units."""
    delimiter = most_frequent_delimiter(header)
    names = header.split(delimiter)
    units = [cell.strip(" \r()[]") for cell in below.split(delimiter)]
    present = [unit for unit in units if unit]
    is_units = len(present) >= len(names) / 2 and all(map(is_unit, present))
    if len(names) < 2 or len(units) > len(names) or not is_units:
        return ""
    return delimiter.join(
        f"{name} [{unit}]" if unit and parse_header_cell(name).unit is None else name
        for name, unit in zip_longest(names, units, fillvalue="")
    )


def has_columns(*names: str, any_of: Collection[str] = ()) -> Callable[[bytes], bool]:
    """Return a function that tests a file for all of `names` and, if given, one of `any_of`.

    Units in brackets are ignored.
    """

    def recognizes(head: bytes) -> bool:
        text = head.removeprefix(BYTE_ORDER_MARK).replace(b"\r", b"")
        first = find_header(normalise_rows(text, []), []).text
        columns = {
            parse_header_cell(cell).name for cell in first.split(most_frequent_delimiter(first))
        }
        return columns.issuperset(names) and (not any_of or not columns.isdisjoint(any_of))

    return recognizes


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
