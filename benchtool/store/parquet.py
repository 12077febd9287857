"""samples.parquet: the samples of a closed run once more, hashed, quicker to read."""

from __future__ import annotations

from math import nan
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.recording import Recording
from benchtool.core.table_bounds import check_decoded
from benchtool.core.user_file import open_file
from benchtool.errors import FileFormatError, UnknownChoice
from benchtool.store.columns import WORDS, channel_called, code_of

Array = NDArray[np.float64]


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
    """Return the samples of a Parquet file that `write_parquet` wrote.

    It is read in pieces into one array, so that little more memory is taken than that array's.

    Raises:
        FileFormatError: it is no Parquet file, is too large when read, or holds a column that is
            neither of numbers nor of our own words.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    where = str(path)
    try:
        with open_file(path) as opened, pq.ParquetFile(opened) as file:
            facts = file.metadata
            groups = [facts.row_group(index) for index in range(facts.num_row_groups)]
            packed_bytes = sum(group.total_byte_size for group in groups)
            check_decoded(facts.num_rows, facts.num_columns, packed_bytes, where)
            names = file.schema_arrow.names
            for field in file.schema_arrow:
                _check_type(field, where)
            values = np.empty((facts.num_rows, len(names)))
            at = 0
            for batch in file.iter_batches(use_threads=False):
                rows = slice(at, at + batch.num_rows)
                for index, name in enumerate(names):
                    values[rows, index] = _numbers(name, batch.column(index))
                at = rows.stop
    except UnknownChoice as error:
        raise FileFormatError(where, str(error)) from error
    except MemoryError:
        raise
    except (pa.ArrowException, OSError, ValueError) as error:
        problem = " ".join(str(error).split())[:200]
        problem = f"it cannot be read as Parquet ({problem}); restore it from a copy"
        raise FileFormatError(where, problem) from error
    return Recording(tuple(channel_called(name) for name in names), values[:at])


def _check_type(field: Any, where: str) -> None:
    from pyarrow import types

    kind = field.type
    if field.name in WORDS and (types.is_string(kind) or types.is_dictionary(kind)):
        return
    if not (types.is_floating(kind) or types.is_integer(kind) or types.is_boolean(kind)):
        raise FileFormatError(
            where, f"column {field.name!r} holds {kind}, not numbers; restore it from a copy"
        )


def _numbers(name: str, column: Any) -> Array:
    if name not in WORDS:
        return np.asarray(column.to_numpy(zero_copy_only=False), float)
    coded = column if hasattr(column, "dictionary") else column.dictionary_encode()
    codes = np.array([code_of(name, str(word)) for word in coded.dictionary.to_pylist()] + [nan])
    numbers: Array = codes[coded.indices.fill_null(len(codes) - 1).to_numpy()]
    return numbers
