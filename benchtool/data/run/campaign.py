"""Tables of campaigns: one tidy Parquet file, written row group by row group as results come."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from benchtool.core.errors import WouldOverwrite

ROWS_AT_ONCE = 4096


def write_campaign(
    rows: Iterable[Mapping[str, float | str]], path: Path, metadata: Mapping[str, str]
) -> int:
    """Write rows of the same columns to a new table as they come and return how many.

    The file gets its name when it is complete; until then, and after an error, it ends in `.part`.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    part = unfinished(path)
    for present in (path, part):
        if present.exists():
            raise WouldOverwrite(str(present))
    path.parent.mkdir(parents=True, exist_ok=True)
    writer: Any = None
    pending: list[dict[str, float | str]] = []

    def flush() -> None:
        nonlocal writer
        if pending:
            table = pa.Table.from_pylist(pending)
            if writer is None:
                schema = table.schema.with_metadata(dict(metadata))
                writer = pq.ParquetWriter(part, schema, compression="zstd")
            writer.write_table(table.cast(writer.schema))
            pending.clear()

    count = 0
    try:
        for row in rows:
            count += 1
            pending.append(dict(row))
            if len(pending) >= ROWS_AT_ONCE:
                flush()
    finally:
        flush()
        if writer is not None:
            writer.close()
    if part.exists():
        part.replace(path)
    return count


def unfinished(path: Path) -> Path:
    """Return where a campaign's table is until it is complete."""
    return path.with_name(path.name + ".part")


def campaign_batches(path: Path, columns: Sequence[str]) -> Iterator[dict[str, NDArray[Any]]]:
    """Yield some columns of a campaign's table, (n_rows,) each, a few thousand rows at once."""
    import pyarrow.parquet as pq

    with pq.ParquetFile(path) as file:
        for batch in file.iter_batches(batch_size=ROWS_AT_ONCE, columns=list(columns)):
            yield {name: batch.column(name).to_numpy(zero_copy_only=False) for name in columns}
