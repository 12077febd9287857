"""The jobs of the Fit tab: light to import here, the work is loaded where it is done."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from benchtool.core.column_source import ColumnSource
from benchtool.web.shown import Piece, Shown


def view_fit(root: Path, name: str) -> Shown:
    """See `view.view_fit`."""
    from benchtool.web.fits import view

    return view.view_fit(root, name)


def keep_columns(root: Path, name: str, columns: Mapping[str, ColumnSource]) -> tuple[Piece, ...]:
    """See `keep.keep_columns`."""
    from benchtool.web.fits import keep

    return keep.keep_columns(root, name, columns)
