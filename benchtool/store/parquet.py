"""samples.parquet: the samples of a closed run once more, hashed, quicker to read."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.recording import Recording
from benchtool.store.atomic import sync_folder
from benchtool.store.columns import WORDS, channel_called
from benchtool.store.sample_stream import WholeLines, codes_of, sample_batches


def write_parquet(path: Path, samples: Recording) -> None:
    """Write samples in one step; columns of words become dictionary columns."""
    import pyarrow as pa

    units = {channel.name: channel.unit for channel in samples.channels}
    columns = []
    for name in samples.names:
        values = samples.column(name)
        if name in WORDS:
            columns.append(_words(name, pa.array(values.astype(np.int32))))
        else:
            columns.append(pa.array(values, from_pandas=True))
    with _writer(path, units) as writer:
        writer.write_table(pa.table(columns, schema=writer.schema))


def seal(csv: Path, path: Path) -> None:
    """Write the rows of samples.csv as Parquet in one step, a batch at a time."""
    import pyarrow as pa

    with WholeLines(csv) as lines:
        names = lines.names
        units = {name: channel_called(name).unit for name in names}
        with _writer(path, units) as writer:
            for batch in sample_batches(lines, csv, names):
                columns = [
                    _words(name, codes_of(name, cells, csv)) if name in WORDS else cells
                    for name, cells in zip(names, batch.columns, strict=True)
                ]
                writer.write_batch(pa.record_batch(columns, schema=writer.schema))


def read_parquet(path: Path, names: Sequence[str] | None = None) -> Recording:
    """Return the samples of a Parquet file that was written here.

    Args:
        path: of the file.
        names: of the columns to read, those that are not in the file left out; all when left out.
    """
    import pyarrow.parquet as pq

    with pq.ParquetFile(path) as file:
        present = [name for name in file.schema_arrow.names if names is None or name in names]
        values = np.empty((file.metadata.num_rows, len(present)))
        at = 0
        for batch in file.iter_batches(columns=present, use_threads=False):
            end = at + batch.num_rows
            for column, name in enumerate(present):
                cells = batch.column(column)
                if name in WORDS:
                    cells = codes_of(name, cells.dictionary_decode(), path)
                values[at:end, column] = cells.to_numpy(zero_copy_only=False)
            at = end
    return Recording(tuple(channel_called(name) for name in present), values)


@contextmanager
def _writer(path: Path, units: dict[str, str]) -> Iterator[Any]:
    """Give a writer of a file that gets its name once it is whole and on the disk."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    word = pa.dictionary(pa.int32(), pa.string())
    schema = pa.schema(
        [(name, word if name in WORDS else pa.float64()) for name in units],
        {f"unit:{name}": unit for name, unit in units.items()},
    )
    beside = path.with_name(f".{path.name}.new")
    try:
        dictionary = [name for name in units if name in WORDS]
        with pq.ParquetWriter(
            beside, schema, compression="zstd", use_dictionary=dictionary
        ) as writer:
            yield writer
        with open(beside, "rb+") as file:
            os.fsync(file.fileno())
        os.replace(beside, path)
    except BaseException:
        with suppress(OSError):
            beside.unlink()
        raise
    sync_folder(path.parent)


def _words(name: str, codes: Any) -> Any:
    import pyarrow as pa

    return pa.DictionaryArray.from_arrays(codes, pa.array(WORDS[name]))
