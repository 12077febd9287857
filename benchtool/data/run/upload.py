"""A table that somebody hands over, taken as untrusted: size and shape before numbers."""

from __future__ import annotations

import re
from pathlib import Path

from benchtool.core.errors import FileFormatError
from benchtool.data.atomic import sync_folder
from benchtool.data.csv_text import CsvTable, no_rows, parse_csv
from benchtool.data.run.runs_folder import RunsFolder

MOST_BYTES = 20_000_000
"""A table of points is a few kilobytes; this is room for a log. A choice."""

MOST_COLUMNS = 500


def checked_table(data: bytes, name: str) -> CsvTable:
    """Return the cells of a table that was handed over.

    Raises:
        FileFormatError: too large, no CSV, no row, or more columns than anybody would map.
    """
    if len(data) > MOST_BYTES:
        raise FileFormatError(
            name,
            f"it has {len(data) / 1e6:.1f} MB, and at most {MOST_BYTES / 1e6:.0f} MB are taken; "
            f"cut it, or put it into the runs folder yourself",
        )
    table = parse_csv(data, name)
    if len(table.header) > MOST_COLUMNS:
        raise FileFormatError(
            name,
            f"its header names {len(table.header)} columns, and at most {MOST_COLUMNS} are taken; "
            f"keep those of a fit",
        )
    if not table.rows:
        raise no_rows(name, table.header)
    return table


def keep_table(folder: RunsFolder, name: str, data: bytes, date: str) -> Path:
    """Write a checked table into a folder of its own in the runs folder and return its path.

    Args:
        folder: of runs.
        name: of the file as it was handed over; only letters, digits and a few signs stay.
        data: its bytes.
        date: begins the folder's name.

    Raises:
        FileFormatError: see `checked_table`; nothing was written.
    """
    shown = re.split(r"[/\\]", name)[-1]
    checked_table(data, shown[:80] or "the file")
    stem = re.sub(r"[^A-Za-z0-9_-]+", "-", Path(shown).stem).strip("-_")[:60] or "table"
    place = folder.free_path(date, stem)
    place.mkdir(parents=True)
    path = place / f"{stem}.csv"
    path.write_bytes(data)
    sync_folder(place)
    return path


def columns_file(table: Path) -> Path:
    """Return where the mapping file of a table stands, which says which column is which."""
    return table.with_name(f"{table.stem}.columns.toml")
