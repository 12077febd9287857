"""samples.parquet: hashed copy of a closed run's samples, faster to read than CSV."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.errors import FileFormatError
from benchtool.core.recording import Recording
from benchtool.core.user_file import check_columns, check_decoded, open_file
from benchtool.data.atomic import atomic_writer
from benchtool.data.columns import WORDS, find_channel
from benchtool.data.run.sample_stream import WholeLines, encode_words, read_batches, stack_batches

_BATCH_ROWS = 1 << 13


def load_library() -> None:
    """Import the packages for closing a run, so that an import error occurs before motors turn."""
    # Arrow's own allocator takes 1 GB of addresses at once, which a limit on them may not allow.
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
    for name in ("pyarrow.compute", "pyarrow.parquet"):
        import_module(name)
    import pyarrow as pa

    pa.array([0])  # Arrow imports pandas with its first array


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
    """Write the rows of samples.csv as Parquet, atomically and in batches.

    Args:
        csv_sha256: of samples.csv, for the metadata.
    """
    load_library()
    import pyarrow as pa

    with WholeLines(csv) as lines:
        names = lines.names
        units = {name: find_channel(name).unit for name in names}
        with _writer(path, units, {"sha256": csv_sha256, "file": csv.name}) as writer:
            for batch in read_batches(lines, csv, names):
                columns = [
                    _encode(name, pa.array(encode_words(name, cells, csv)))
                    if name in WORDS
                    else cells
                    for name, cells in zip(names, batch.columns, strict=True)
                ]
                writer.write_batch(pa.record_batch(columns, schema=writer.schema))


def read_parquet(path: Path, names: Sequence[str] | None = None) -> Recording:
    """Return the samples of a Parquet file written by benchtool.

    Args:
        names: columns to read, missing ones are ignored; None reads all.

    Raises:
        FileFormatError: not a Parquet file, too large when decoded, or a column of another type
            than numbers or known labels.
    """
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
