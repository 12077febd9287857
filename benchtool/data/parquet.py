"""Tables of runs read and written with Arrow: samples.csv, samples.parquet and campaigns.

samples.parquet is a hashed copy of a closed run's samples, faster to read than CSV. CSV is read in
batches, with memory for about 10,000 rows, independent of the run's length.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import FileFormatError, InputError, WouldOverwrite
from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.core.user_file import check_columns, check_decoded, open_file
from benchtool.data.atomic import atomic_writer
from benchtool.data.columns import WORDS, find_channel

BLOCK_BYTES = 1 << 20  # block size of the CSV parser, about 6,000 rows of 20 columns; assumed
MAX_HEADER_BYTES = 1 << 16
ROW_GROUP_SIZE = 4096  # rows of a campaign written at once
_BATCH_ROWS = 1 << 13


def load_library() -> None:
    """Import the packages for closing a run, so that an import error occurs before motors turn."""
    # Arrow's own allocator takes 1 GB of addresses at once, which a limit on them may not allow.
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
    for name in ("pyarrow.compute", "pyarrow.parquet"):
        import_module(name)
    import pyarrow as pa

    pa.array([0])  # Arrow imports pandas with its first array


def load_extra(module: str, extra: str, what: str) -> Any:
    """Return a module that `benchtool[EXTRA]` installs; `what` is the subject of its error."""
    try:
        return import_module(module)
    except ImportError as error:
        package = module.partition(".")[0]
        raise InputError(
            f"{what} needs the package {package}, which is not installed; "
            f"pip install 'benchtool[{extra}]'"
        ) from error


def write_parquet(path: Path, samples: Recording) -> None:
    """Write samples atomically; columns of labels become dictionary columns.

    The schema's metadata contain the unit of each column (`unit:NAME`) and the provenance with the
    hash of the data (`provenance:sha256`).
    """
    import pyarrow as pa

    units = {channel.name: channel.unit for channel in samples.channels}
    columns = []
    for name in samples.names:
        values = samples.column(name)
        if name in WORDS:
            columns.append(_encode(name, pa.array(values.astype(np.int32))))
        else:
            columns.append(pa.array(values, from_pandas=True))
    with _writer(path, units, samples.provenance) as writer:
        writer.write_table(pa.table(columns, schema=writer.schema))


def finalize_parquet(csv: Path, path: Path, csv_sha256: str) -> None:
    """Write the rows of samples.csv as Parquet, atomically and in batches."""
    load_library()
    import pyarrow as pa

    names = read_header(csv)
    units = {name: find_channel(name).unit for name in names}
    with _writer(path, units, {"sha256": csv_sha256, "file": csv.name}) as writer:
        for batch in read_batches(csv, names, scan_lines(csv)[1]):
            columns = [
                _encode(name, pa.array(encode_words(name, cells, csv))) if name in WORDS else cells
                for name, cells in zip(names, batch.columns, strict=True)
            ]
            writer.write_batch(pa.record_batch(columns, schema=writer.schema))


def read_parquet(path: Path, names: Sequence[str] | None = None) -> Recording:
    """Return the samples of a Parquet file written by benchtool; `names` as in `read_samples`."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    where = str(path)
    try:
        with open_file(path, follow=False) as stream, pq.ParquetFile(stream) as file:
            schema = file.schema_arrow
            check_columns(len(schema.names), where)
            present = [name for name in schema.names if names is None or name in names]
            for name in present:
                _check_type(schema.field(name), where)
            rows = file.metadata.num_rows
            check_decoded(rows, len(present), where)
            batches = file.iter_batches(_BATCH_ROWS, columns=present, use_threads=False)
            values = stack_batches(batches, present, rows, path)
    except MemoryError:
        raise
    except (pa.ArrowException, KeyError, OSError, ValueError) as error:
        problem = " ".join(str(error).split())[:200]
        problem = f"it cannot be read as Parquet ({problem}); restore it from a copy"
        raise FileFormatError(where, problem) from error
    return Recording(tuple(find_channel(name) for name in present), values)


def parquet_names(path: Path) -> tuple[str, ...]:
    """Return the column names of a Parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with open_file(path, follow=False) as stream:
            return tuple(pq.read_schema(stream).names)
    except (pa.ArrowException, OSError) as error:
        problem = "it cannot be read as Parquet; restore it from a copy"
        raise FileFormatError(str(path), problem) from error


def _check_type(field: Any, where: str) -> None:
    from pyarrow import types

    kind = field.type
    if field.name in WORDS:
        good = types.is_string(kind) or types.is_dictionary(kind)
    else:
        good = types.is_floating(kind) or types.is_integer(kind) or types.is_boolean(kind)
    if not good:
        raise FileFormatError(
            where, f"column {field.name!r} has the wrong type {kind}; restore it from a copy"
        )


@contextmanager
def _writer(path: Path, units: dict[str, str], provenance: Mapping[str, str]) -> Iterator[Any]:
    """Yield a writer of a file that is renamed to `path` when complete and synced to disk."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    word = pa.dictionary(pa.int32(), pa.string())
    schema = pa.schema(
        [(name, word if name in WORDS else pa.float64()) for name in units],
        {f"unit:{name}": unit for name, unit in units.items()}
        | {f"provenance:{name}": text for name, text in provenance.items()},
    )
    dictionary = [name for name in units if name in WORDS]
    with (
        atomic_writer(path, path.with_name(f".{path.name}.new")) as file,
        pq.ParquetWriter(file, schema, compression="zstd", use_dictionary=dictionary) as writer,
    ):
        yield writer


def _encode(name: str, codes: Any) -> Any:
    import pyarrow as pa

    return pa.DictionaryArray.from_arrays(codes, pa.array(WORDS[name]))


def scan_lines(path: Path) -> tuple[int, int, bool]:
    """Return the number of rows of a CSV table and the size of its complete lines.

    The last item is whether an incomplete line of a killed process follows.
    """
    rows, end, size = -1, 0, 0
    with open_file(path, follow=False) as file:
        while block := file.read(1 << 20):
            rows += block.count(b"\n")
            if (last := block.rfind(b"\n")) >= 0:
                end = size + last + 1
            size += len(block)
    return rows, end, end < size


def read_header(path: Path, *, follow: bool = False) -> tuple[str, ...]:
    """Return the column names of a table."""
    with open_file(path, follow=follow) as file:
        line = file.readline(MAX_HEADER_BYTES).decode("utf-8", "replace")
    return tuple(line.strip("\r\n").split(","))


def read_batches(path: Path, names: Sequence[str], end: int) -> Iterator[Any]:
    """Yield record batches of columns up to byte `end`; words are text, an empty number is null.

    No thread is started: Arrow's CSV reader hangs if the system refuses one.
    """
    import pyarrow as pa

    header = read_header(path)
    n_columns, incomplete, first_line = len(header), b"", 2
    with open_file(path, follow=False) as file:
        remaining = end - len(file.readline(MAX_HEADER_BYTES))
        while remaining > 0 and (block := file.read(min(BLOCK_BYTES, remaining))):
            remaining -= len(block)
            *rows, incomplete = (incomplete + block).replace(b"\r\n", b"\n").split(b"\n")
            for line, row in enumerate(rows, first_line):
                if row and row.count(b",") != n_columns - 1:
                    problem = f"line {line} has {pluralize(row.count(b',') + 1, 'cell')}"
                    raise FileFormatError(
                        str(path), f"{problem}, its header {n_columns}; correct that line"
                    )
            first_line += len(rows)
            if len(incomplete) > BLOCK_BYTES:
                problem = f"line {first_line} is too long; allowed: {BLOCK_BYTES:,} bytes"
                raise FileFormatError(str(path), f"{problem}; correct it")
            raw = np.frombuffer(b"".join(row + b"," for row in rows if row), np.uint8)
            ends = np.flatnonzero(raw == ord(","))
            offsets = pa.py_buffer(np.append(0, ends - np.arange(len(ends))).astype(np.int32))
            text = pa.py_buffer(raw[raw != ord(",")])
            cells = pa.Array.from_buffers(pa.string(), len(ends), [None, offsets, text])
            columns = []
            for name in names:
                positions = pa.array(np.arange(header.index(name), len(ends), n_columns))
                columns.append(_parse_cells(name, cells.take(positions), path))
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


def read_stream(path: Path, names: Sequence[str] | None) -> tuple[Recording, tuple[str, ...]]:
    """Return a CSV table that benchtool wrote, and its repairs; `names` as in `read_samples`."""
    header = read_header(path)
    present = [name for name in header if names is None or name in names]
    rows, end, is_incomplete = scan_lines(path)
    check_columns(len(header), str(path))
    check_decoded(max(rows, 0), len(present), str(path))
    values = stack_batches(read_batches(path, present, end), present, max(rows, 0), path)
    repairs = ("the last line was cut short and left out",) if is_incomplete else ()
    return Recording(tuple(map(find_channel, present)), values), repairs


def write_campaign(
    rows: Iterable[Mapping[str, float | str]], path: Path, metadata: Mapping[str, str]
) -> int:
    """Write rows of equal columns to a new table and return their number.

    The file name ends in `.part` until the table is complete.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    if path.exists():
        raise WouldOverwrite(str(path))
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    remaining, count, writer = iter(rows), 0, None
    try:
        while group := [dict(row) for row in islice(remaining, ROW_GROUP_SIZE)]:
            table = pa.Table.from_pylist(group)
            if writer is None:
                schema = table.schema.with_metadata(dict(metadata))
                writer = pq.ParquetWriter(part, schema, compression="zstd")
            writer.write_table(table.cast(writer.schema))
            count += len(group)
    finally:
        if writer is not None:
            writer.close()
    if count:
        part.replace(path)
    return count


def campaign_means(path: Path, measure: str) -> dict[tuple[str, str], float]:
    """Return the mean of a measure by gain set and controller, over the finite values."""
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    keys = ["gains", "controller"]
    table = pq.read_table(path, columns=[*keys, measure], read_dictionary=keys)
    finite = table.filter(pc.is_finite(table[measure]))
    rows = finite.group_by(keys).aggregate([(measure, "mean")]).to_pylist()
    return {(row["gains"], row["controller"]): row[f"{measure}_mean"] for row in rows}
