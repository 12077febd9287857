"""Batched reader of samples.csv; memory for about 10,000 rows, independent of the run's length."""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import FileFormatError
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.core.user_file import check_columns, check_decoded, open_file
from benchtool.data.columns import WORDS

BLOCK_BYTES = 1 << 20  # block size of the parser, about 6,000 rows of 20 columns; assumed
MAX_HEADER_BYTES = 1 << 16


class WholeLines(io.RawIOBase):
    """File reader that ends at the last line end, before an incomplete line of a killed process.

    Attributes:
        lines: number of lines below the header.
        is_incomplete: whether there are bytes after the last line end.
    """

    def __init__(self, path: Path) -> None:
        self._file = open_file(path, follow=False)
        self.lines, end, size = -1, 0, 0
        while block := self._file.read(1 << 20):
            self.lines += block.count(b"\n")
            if (last := block.rfind(b"\n")) >= 0:
                end = size + last + 1
            size += len(block)
        self.is_incomplete = end < size
        self._remaining = end
        self._file.seek(0)
        self.names = read_header(path)

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        view = memoryview(buffer)[: self._remaining]
        count = self._file.readinto(view) or 0
        self._remaining -= count
        return count

    def close(self) -> None:
        self._file.close()
        super().close()


def read_header(path: Path, *, follow: bool = False) -> tuple[str, ...]:
    """Return the column names of a table."""
    with open_file(path, follow=follow) as file:
        line = file.readline(MAX_HEADER_BYTES).decode("utf-8", "replace")
    return tuple(line.strip("\r\n").split(","))


def read_batches(lines: WholeLines, path: Path, names: Sequence[str]) -> Iterator[Any]:
    """Yield record batches of columns; words are text, an empty number is null.

    No thread is started: Arrow's CSV reader hangs if the system refuses one.

    Raises:
        FileFormatError: a row or cell is invalid.
    """
    import pyarrow as pa

    lines.readline(MAX_HEADER_BYTES)
    n_columns, incomplete, first_line = len(lines.names), b"", 2
    while block := lines.read(BLOCK_BYTES):
        *rows, incomplete = (incomplete + block).replace(b"\r\n", b"\n").split(b"\n")
        for line, row in enumerate(rows, first_line):
            if row and row.count(b",") != n_columns - 1:
                problem = f"line {line} has {pluralize(row.count(b',') + 1, 'cell')}"
                raise FileFormatError(
                    str(path), f"{problem}, its header {n_columns}; correct that line"
                )
        first_line += len(rows)
        if len(incomplete) > BLOCK_BYTES:
            problem = f"line {first_line} is too long; allowed: {BLOCK_BYTES:,} bytes; correct it"
            raise FileFormatError(str(path), problem)
        raw = np.frombuffer(b"".join(row + b"," for row in rows if row), np.uint8)
        ends = np.flatnonzero(raw == ord(","))
        offsets = pa.py_buffer(np.append(0, ends - np.arange(len(ends))).astype(np.int32))
        text = pa.py_buffer(raw[raw != ord(",")])
        cells = pa.Array.from_buffers(pa.string(), len(ends), [None, offsets, text])
        columns = [
            _parse_cells(name, cells.take(pa.array(np.arange(index, len(ends), n_columns))), path)
            for name, index in ((name, lines.names.index(name)) for name in names)
        ]
        yield pa.record_batch(columns, list(names))


def _parse_cells(name: str, cells: Any, path: Path) -> Any:
    """Return a column of text as numbers; columns of words stay text."""
    import pyarrow as pa
    import pyarrow.compute as pc

    try:
        cells.validate(full=True)
        if name in WORDS:
            return cells
        cells = pc.ascii_trim_whitespace(cells)
        is_empty = pc.is_in(cells, pa.array(["", "nan"]))
        return pc.if_else(is_empty, None, cells).cast(pa.float64())
    except pa.ArrowException as error:
        problem = f"column {name!r}: {' '.join(str(error).split())[:200]}; correct that line"
        raise FileFormatError(str(path), problem) from error


def encode_words(name: str, cells: Any, path: Path) -> NDArray[np.int32]:
    """Return the codes (n,) of a column of words; raise for an unknown word or an empty cell."""
    import pyarrow as pa

    encoded = cells.cast(pa.string()).dictionary_encode()
    code_by_word = {word: code for code, word in enumerate(WORDS[name])}
    codes = [code_by_word.get(word, -1) for word in encoded.dictionary.to_pylist()]
    # An empty cell has the index -1, that of the last element.
    result: NDArray[np.int32] = np.array([*codes, -1], np.int32)[
        plain_values(encoded.indices, np.int32, -1)
    ]
    if (result < 0).any():
        word = str(cells[int(np.argmax(result < 0))].as_py())
        raise FileFormatError(
            str(path), f"column {name!r} contains {word[:40]!r}; allowed: {WORDS[name]}"
        )
    return result


def plain_values(cells: Any, dtype: type[Any], null_value: Any) -> NDArray[Any]:
    """Return a column's cells (n,), nulls replaced; Arrow's `to_numpy` would import pandas."""
    valid, buffer = cells.buffers()
    rows = slice(cells.offset, cells.offset + len(cells))
    values = np.frombuffer(buffer, dtype)[rows]
    if not cells.null_count:
        return values
    is_valid = np.unpackbits(np.frombuffer(valid, np.uint8), bitorder="little")[rows]
    return np.where(is_valid, values, null_value)


def stack_batches(batches: Iterable[Any], names: Sequence[str], max_rows: int, path: Path) -> Array:
    """Return the columns of record batches as numbers (n, c), words as codes."""
    import pyarrow as pa

    values = np.empty((max_rows, len(names)))
    start = 0
    for batch in batches:
        end = start + batch.num_rows
        for column, name in enumerate(names):
            cells = batch.column(column)
            values[start:end, column] = (
                encode_words(name, cells, path)
                if name in WORDS
                else plain_values(cells.cast(pa.float64()), np.float64, np.nan)
            )
        start = end
    return values[:start]


def read_stream(path: Path, names: Sequence[str] | None) -> tuple[tuple[str, ...], Array, bool]:
    """Return names and values (n, c) of columns, and whether the last line is incomplete.

    Args:
        names: of columns, missing ones are ignored; default: all.
    """
    with WholeLines(path) as lines:
        present_names = tuple(name for name in lines.names if names is None or name in names)
        n_rows = max(lines.lines, 0)
        check_columns(len(lines.names), str(path))
        check_decoded(n_rows, len(present_names), str(path))
        batches = read_batches(lines, path, present_names)
        values = stack_batches(batches, present_names, n_rows, path)
        return present_names, values, lines.is_incomplete
