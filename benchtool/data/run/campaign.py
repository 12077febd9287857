"""Tables of campaigns: one tidy Parquet file, written row group by row group as results come."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

from numpy.typing import NDArray

from benchtool.core.errors import WouldOverwrite

ROWS_AT_ONCE = 4096


class CampaignWriter:
    """Write rows of one campaign; what is written no longer takes memory.

    The file gets its name when the campaign is complete; until then, and where it was broken off,
    it ends in `.part`.
    """

    def __init__(self, path: Path, metadata: Mapping[str, str]) -> None:
        self.path = path
        self._part = unfinished(path)
        for present in (self.path, self._part):
            if present.exists():
                raise WouldOverwrite(str(present))
        self._metadata = dict(metadata)
        self._rows: list[Mapping[str, float | str]] = []
        self._writer: Any = None

    def __enter__(self) -> CampaignWriter:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._flush()
        if self._writer is not None:
            self._writer.close()
        if kind is None and self._part.exists():
            self._part.replace(self.path)

    def add(self, row: Mapping[str, float | str]) -> None:
        """Add one row; all rows have the same columns."""
        self._rows.append(row)
        if len(self._rows) >= ROWS_AT_ONCE:
            self._flush()

    def _flush(self) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        if not self._rows:
            return
        table = pa.Table.from_pylist([dict(row) for row in self._rows])
        if self._writer is None:
            schema = table.schema.with_metadata(self._metadata)
            self._writer = pq.ParquetWriter(self._part, schema, compression="zstd")
        self._writer.write_table(table.cast(self._writer.schema))
        self._rows.clear()


def write_campaign(
    rows: Iterable[Mapping[str, float | str]], path: Path, metadata: Mapping[str, str]
) -> int:
    """Write rows to a new table as they come and return how many."""
    count = 0
    with CampaignWriter(path, metadata) as writer:
        for row in rows:
            writer.add(row)
            count += 1
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
