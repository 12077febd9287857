"""samples.parquet: the samples of a closed run once more, hashed, quicker to read."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchtool.core.recording import Recording
from benchtool.store.columns import WORDS, channel_called


def write_parquet(path: Path, samples: Recording) -> None:
    """Write samples in one step; columns of words become dictionary columns."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    columns = []
    for name in samples.names:
        values = samples.column(name)
        if name in WORDS:
            codes = pa.array(values.astype(np.int32))
            columns.append(pa.DictionaryArray.from_arrays(codes, pa.array(WORDS[name])))
        else:
            columns.append(pa.array(values, from_pandas=True))
    units = {f"unit:{channel.name}": channel.unit for channel in samples.channels}
    table = pa.table(columns, names=list(samples.names)).replace_schema_metadata(units)
    beside = path.with_name(f".{path.name}.new")
    pq.write_table(table, beside, compression="zstd")
    beside.replace(path)


def read_parquet(path: Path) -> Recording:
    """Return the samples of a Parquet file that `write_parquet` wrote."""
    import pyarrow.parquet as pq

    table = pq.read_table(path)
    pairs = []
    for name in table.column_names:
        column = table.column(name).combine_chunks()
        if name in WORDS:
            position = {word: float(index) for index, word in enumerate(WORDS[name])}
            values = np.array([position[word] for word in column.to_pylist()], float)
        else:
            values = column.to_numpy(zero_copy_only=False).astype(float)
        pairs.append((channel_called(name), values))
    return Recording.from_columns(pairs)
