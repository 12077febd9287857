"""A run's tables as files to hand on: as they stand on the disk, or made anew where they do not."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from benchtool.core.errors import FileFormatError, UnknownChoice
from benchtool.core.recording import Recording
from benchtool.core.user_file import read_file
from benchtool.data.columns import KINDS
from benchtool.data.parquet import write_parquet
from benchtool.data.run.points import write_table
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.settings import aggregate

Table = Literal["points", "settings", "samples"]
TABLES: tuple[Table, ...] = ("points", "settings", "samples")
SUFFIXES = (".csv", ".parquet")


def exported(run: Path, table: str, suffix: str) -> bytes:
    """Return one table of a run as the bytes of a CSV or Parquet file.

    Args:
        run: a run folder.
        table: one of `TABLES`.
        suffix: one of `SUFFIXES`.
    """
    if table not in TABLES:
        raise UnknownChoice("table of a run", table, TABLES)
    if suffix not in SUFFIXES:
        raise UnknownChoice("format of a table", suffix, SUFFIXES)
    file = run / f"{table}{suffix}"
    if file.is_file():
        return read_file(file, follow=False)
    recording = _recording(run, table)
    with TemporaryDirectory() as folder:
        made = Path(folder) / file.name
        (write_table if suffix == ".csv" else write_parquet)(made, recording)
        return made.read_bytes()


def _recording(run: Path, table: str) -> Recording:
    if table == "points":
        return read_points(run, KINDS)
    if table == "settings":
        return aggregate(read_points(run))
    if not any((run / f"samples{suffix}").is_file() for suffix in SUFFIXES):
        raise FileFormatError(run.name, "there are no samples in it, only points made of them")
    return read_samples(run)
