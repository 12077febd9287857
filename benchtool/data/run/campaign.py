"""Campaign tables: one Parquet file, written in row groups while results arrive."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import islice
from pathlib import Path

from benchtool.core.errors import WouldOverwrite

ROW_GROUP_SIZE = 4096


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
