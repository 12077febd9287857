"""Bring the rows of a text table to one width: pad what is short, refuse what holds too much."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from benchtool.core.counted import counted
from benchtool.core.errors import FileFormatError
from benchtool.data.repairs.imported import Finding, line_ranges

if TYPE_CHECKING:
    from benchtool.data.formats.text_table import TextTable

Positions = NDArray[np.intp]

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
        raise FileFormatError(table.where, "there is a header but no row below it; add data")
    while len(names) > 1 and not names[-1]:
        names.pop()
    # A reader that asks to even a table knows its columns already.
    width = len(table.header) if table.is_even else _width(used, len(names))
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
    return replace(
        table,
        header=header,
        body=whole,
        lines=lines[kept],
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
