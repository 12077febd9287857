"""Read a table through a map and keep the map beside it; works in a process of its own."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchtool.core.column_source import ColumnSource
from benchtool.library import columns_to_toml
from benchtool.report.page import Table
from benchtool.store.atomic import replace_text
from benchtool.store.runs_folder import RunsFolder
from benchtool.store.table import read_table
from benchtool.store.upload import columns_file
from benchtool.web.drawing import pieces
from benchtool.web.shown import Piece

FEW_NUMBERS = "{:.4g}"


def keep_columns(root: Path, name: str, columns: Mapping[str, ColumnSource]) -> tuple[Piece, ...]:
    """Read a table through a map, keep the map beside it, and return what it gave.

    Raises:
        FileFormatError: a cell that is no number, with its line; nothing was kept.
    """
    path = RunsFolder(root).file_of(name)
    recording = read_table(path, columns)
    rows = []
    for channel in recording.channels:
        values = recording.column(channel.name)
        known = values[np.isfinite(values)]
        least, most = (known.min(), known.max()) if known.size else (np.nan, np.nan)
        rows.append(
            (
                channel.name,
                channel.unit,
                str(known.size),
                FEW_NUMBERS.format(least),
                FEW_NUMBERS.format(most),
            )
        )
    replace_text(columns_file(path), columns_to_toml(columns))
    table = Table(
        f"{len(recording)} rows as they will be fitted.",
        ("channel", "unit", "numbers", "least", "most"),
        rows,
        text_columns=2,
    )
    return pieces([table])
