"""samples.csv in batches: memory for some ten thousand rows, however long the run was."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.errors import FileFormatError
from benchtool.core.plural import pluralize
from benchtool.core.table_bounds import check_columns, check_decoded
from benchtool.core.user_file import open_file
from benchtool.data.columns import WORDS

BLOCK_BYTES = 1 << 20  # Read and parsed at once: some 6,000 rows of 20 columns; a choice

MAX_HEADER_BYTES = 1 << 16


class WholeLines(io.RawIOBase):
    """Read a file up to its last line end; what a kill left behind it is no row.

    Attributes:
        lines: how many there are below the header.
        cut: whether something stands behind the last line end.
    """

    def __init__(self, path: Path) -> None:
        self._file = open_file(path, follow=False)
        self.lines, end, size = -1, 0, 0
        while block := self._file.read(1 << 20):
            self.lines += block.count(b"\n")
            if (last := block.rfind(b"\n")) >= 0:
                end = size + last + 1
            size += len(block)
        self.cut = end < size
        self._left = end
        self._file.seek(0)
        self.names = read_header(path)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer)[: self._left]
        count = self._file.readinto(view) or 0
        self._left -= count
        return count

    def close(self) -> None:
        self._file.close()
        super().close()


def read_header(path: Path, *, follow: bool = False) -> tuple[str, ...]:
    """Return the names in the first line of a table."""
    with open_file(path, follow=follow) as file:
        line = file.readline(MAX_HEADER_BYTES).decode("utf-8", "replace")
    return tuple(line.strip("\r\n").split(","))


def sample_batches(lines: WholeLines, path: Path, names: Sequence[str]) -> Iterator[Any]:
    """Yield record batches of some columns; words are text, a blank number is null.

    No thread is started: Arrow's own reader of CSV waits forever for one that the system refuses.

    Args:
        names: of the columns, all of them in the file.

    Raises:
        FileFormatError: a row or cell that cannot be read.
    """
    import pyarrow as pa

    lines.readline(MAX_HEADER_BYTES)
    n_columns, incomplete, first = len(lines.names), b"", 2
    while block := lines.read(BLOCK_BYTES):
        *rows, incomplete = (incomplete + block).replace(b"\r\n", b"\n").split(b"\n")
        for number, row in enumerate(rows, first):
            if row and row.count(b",") != n_columns - 1:
                problem = f"line {number} has {pluralize(row.count(b',') + 1, 'cell')}"
                raise FileFormatError(
                    str(path), f"{problem}, its header {n_columns}; mend that line"
                )
        first += len(rows)
        if len(incomplete) > BLOCK_BYTES:
            problem = f"line {first} is longer than {BLOCK_BYTES:,} bytes; mend that line"
            raise FileFormatError(str(path), problem)
        raw = np.frombuffer(b"".join(row + b"," for row in rows if row), np.uint8)
        ends = np.flatnonzero(raw == ord(","))
        bounds = pa.py_buffer(np.append(0, ends - np.arange(len(ends))).astype(np.int32))
        text = pa.py_buffer(raw[raw != ord(",")])
        cells = pa.Array.from_buffers(pa.string(), len(ends), [None, bounds, text])
        columns = [
            _parse_cells(name, cells.take(pa.array(np.arange(index, len(ends), n_columns))), path)
            for name, index in ((name, lines.names.index(name)) for name in names)
        ]
        yield pa.record_batch(columns, list(names))


def _parse_cells(name: str, cells: Any, path: Path) -> Any:
    """Return a column's text as numbers; words stay text."""
    import pyarrow as pa
    import pyarrow.compute as pc

    try:
        cells.validate(full=True)
        if name in WORDS:
            return cells
        cells = pc.ascii_trim_whitespace(cells)
        blank = pc.is_in(cells, pa.array(["", "nan"]))
        return pc.if_else(blank, None, cells).cast(pa.float64())
    except pa.ArrowException as error:
        problem = f"column {name!r}: {' '.join(str(error).split())[:200]}; mend that line"
        raise FileFormatError(str(path), problem) from error


def codes_of(name: str, words: Any, path: Path) -> NDArray[np.int32]:
    """Return the positions (n,) of words in their list.

    Raises:
        FileFormatError: a word that is not in the list, or a blank.
    """
    import pyarrow as pa

    encoded = words.cast(pa.string()).dictionary_encode()
    own = {word: position for position, word in enumerate(WORDS[name])}
    codes = [own.get(word, -1) for word in encoded.dictionary.to_pylist()]
    # A blank has no index, and stands for the last entry.
    found: NDArray[np.int32] = np.array([*codes, -1], np.int32)[
        plain_values(encoded.indices, np.int32, -1)
    ]
    if (found < 0).any():
        strange = str(words[int(np.argmax(found < 0))].as_py())
        raise FileFormatError(
            str(path), f"column {name!r} holds {strange[:40]!r}, which is none of {WORDS[name]}"
        )
    return found


def plain_values(cells: Any, kind: type[Any], blank: Any) -> NDArray[Any]:
    """Return a column's cells (n,), blanks replaced; Arrow's own `to_numpy` imports pandas."""
    valid, values = cells.buffers()
    own = slice(cells.offset, cells.offset + len(cells))
    out = np.frombuffer(values, kind)[own]
    if not cells.null_count:
        return out
    return np.where(
        np.unpackbits(np.frombuffer(valid, np.uint8), bitorder="little")[own], out, blank
    )


def numbers_of(batches: Iterable[Any], names: Sequence[str], rows: int, path: Path) -> Array:
    """Return the columns of record batches (n, c), at most `rows`; words become their positions."""
    import pyarrow as pa

    values = np.empty((rows, len(names)))
    at = 0
    for batch in batches:
        end = at + batch.num_rows
        for column, name in enumerate(names):
            cells = batch.column(column)
            values[at:end, column] = (
                codes_of(name, cells, path)
                if name in WORDS
                else plain_values(cells.cast(pa.float64()), np.float64, np.nan)
            )
        at = end
    return values[:at]


def read_stream(path: Path, names: Sequence[str] | None) -> tuple[tuple[str, ...], Array, bool]:
    """Return names and numbers (n, c) of some columns, and whether the last line was cut.

    Args:
        names: of the columns, those that are not in the file left out; all when left out.
    """
    with WholeLines(path) as lines:
        present = tuple(name for name in lines.names if names is None or name in names)
        rows = max(lines.lines, 0)
        check_columns(len(lines.names), str(path))
        check_decoded(rows, len(present), str(path))
        values = numbers_of(sample_batches(lines, path, present), present, rows, path)
        return present, values, lines.cut
