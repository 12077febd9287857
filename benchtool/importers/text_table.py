"""Lay out the rows of foreign CSV bytes: every line kept, mended with words, or refused.

Nothing is turned into numbers here; the bytes stay bytes, so that a million rows take as long as
finding their commas does.
"""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.errors import FileFormatError
from benchtool.importers.finding import Finding, counted, line_ranges

Positions = NDArray[np.intp]

_DECIMAL_COMMA = re.compile(rb"(?:^|[;\t])\s*[+-]?\d+,\d")
_START_BYTES = 1 << 16
_NEWLINE, _CUT = 10, "the last line was cut"


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TextTable:
    """Hold the rows of a text file, all of one width.

    Attributes:
        where: the file's path as given.
        header: (w,) column names without surrounding blanks; "" for a column without a name.
        body: the rows as bytes, each of w cells, ended by a newline.
        lines: (n,) line number of each row in the file, from 1.
        delimiter: one character.
        decimal: "." or ",".
        rows_in_file: lines below the header that hold anything.
        findings: what was mended or refused.
    """

    where: str
    header: tuple[str, ...]
    body: bytes
    lines: Positions
    delimiter: str
    decimal: str
    rows_in_file: int
    findings: tuple[Finding, ...]


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
    body, line_of = data[rest_at:], None
    if b'"' in body or '"' in first:
        first, body, line_of = _unquoted(first, body, delimiter, where)
    names = [cell.strip() for cell in first.split(delimiter)]
    if not any(names):
        raise FileFormatError(where, "the first line names no columns; add a header line")
    decimal = "."
    if delimiter != "," and _DECIMAL_COMMA.search(body[:_START_BYTES]):
        decimal = ","
        _repaired(findings, "decimal commas", "decimal commas are read as points")
    return _regular(body, names, where, delimiter, decimal, header_line, line_of, findings)


def _repaired(findings: list[Finding], what: str, words: str, **more: object) -> None:
    findings.append(Finding("repaired", what, words, **more))  # type: ignore[arg-type]


def _as_plain_text(data: bytes, where: str, findings: list[Finding]) -> bytes:
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        data = data.decode("utf-16", "replace").encode()
        _repaired(findings, "UTF-16", "the text is UTF-16, as Excel saves it; read as UTF-8")
    if data.startswith(b"\xef\xbb\xbf"):
        data = data[3:]
        _repaired(findings, "byte order mark", "a byte order mark at the start was left out")
    if not data.strip():
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
    at, line = 0, 0
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
    whole = "\n".join(rows[1:])
    return rows[0], whole.encode(), np.array(lines[1:], np.intp)


def _regular(
    body: bytes,
    names: list[str],
    where: str,
    delimiter: str,
    decimal: str,
    header_line: int,
    line_of: Positions | None,
    findings: list[Finding],
) -> TextTable:
    """Bring every row to one width: pad what is short, refuse what holds too much."""
    cut_at_end = bool(body) and not body.endswith(b"\n")
    if cut_at_end:
        body += b"\n"
    text = np.frombuffer(body, np.uint8)
    ends = np.flatnonzero(text == _NEWLINE)
    starts = np.concatenate([[0], ends[:-1] + 1]) if ends.size else ends
    marks = np.flatnonzero(text == ord(delimiter))
    counts = np.diff(np.searchsorted(marks, ends), prepend=0)
    lines = header_line + 1 + (np.arange(ends.size) if line_of is None else line_of - 1)
    blank = (ends - starts == 0) | ((counts > 0) & (ends - starts == counts))
    blank_rows = int(np.count_nonzero(blank & (counts > 0)))
    used = counts[~blank] + 1
    if not used.size:
        raise FileFormatError(where, "there is a header but no row below it; add data")
    while len(names) > 1 and not names[-1]:
        names.pop()
    width = _width(used, len(names))
    irregular = np.flatnonzero(~blank & (counts + 1 != width))
    if not irregular.size and not blank.any():
        kept, whole = np.ones(ends.size, bool), body
    else:
        kept, whole = _mended(
            body, starts, ends, blank, irregular, width, delimiter, lines, cut_at_end, findings
        )
    if cut_at_end and kept[-1]:
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
    _tell_widths(used, names, width, findings)
    header = (*names[:width], *[""] * (width - len(names)))
    return TextTable(
        where=where,
        header=header,
        body=whole,
        lines=lines[kept],
        delimiter=delimiter,
        decimal=decimal,
        rows_in_file=int(used.size),
        findings=tuple(findings),
    )


def _width(used: Positions, named: int) -> int:
    """Return how many cells a row is brought to: all that have names, or what most rows have."""
    within = used[used <= named]
    usual = int(np.bincount(used).argmax())
    return max(usual, int(within.max()) if within.size else 1)


def _tell_widths(used: Positions, names: list[str], width: int, findings: list[Finding]) -> None:
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
    kept = ~blank
    short, long, blanks = [], [], []
    instead: dict[int, bytes] = {}
    last = len(ends) - 1
    for i in irregular.tolist():
        cells = body[starts[i] : ends[i]].split(mark)
        if not b"".join(cells).strip():
            kept[i] = False
            blanks.append(i)
        elif len(cells) < width:
            if cut_at_end and i == last:
                kept[i] = False
                continue
            short.append(i)
            instead[i] = mark.join(cells + [b""] * (width - len(cells))) + b"\n"
        elif any(cell.strip() for cell in cells[width:]):
            kept[i] = False
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
    if cut_at_end and not kept[last] and not blank[last] and last not in (*long, *blanks):
        words = "the last line ends in the middle of the row"
        findings.append(Finding("refused", _CUT, words, count=1, lines=str(lines[last])))
    return kept, _joined(body, starts, ends, kept, instead)


def _joined(
    body: bytes,
    starts: Positions,
    ends: Positions,
    kept: NDArray[np.bool_],
    instead: dict[int, bytes],
) -> bytes:
    """Return the kept lines, whole stretches of untouched ones at once."""
    touched = ~kept
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
