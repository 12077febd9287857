"""The jobs of the Runs tab: light to import here, the work is loaded where it is done."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchtool.web.shown import Shown


def view_entry(root: Path, name: str) -> tuple[Shown, tuple[str, ...]]:
    """See `view.view_entry`."""
    from benchtool.web.runs import view

    return view.view_entry(root, name)


def view_part(root: Path, name: str, part: str) -> Shown:
    """See `view.view_part`."""
    from benchtool.web.runs import view

    return view.view_part(root, name, part)


def view_comparison(root: Path, names: Sequence[str]) -> Shown:
    """See `view.view_comparison`."""
    from benchtool.web.runs import view

    return view.view_comparison(root, names)


def report_bytes(root: Path, names: Sequence[str], suffix: str) -> bytes:
    """See `view.report_bytes`."""
    from benchtool.web.runs import view

    return view.report_bytes(root, names, suffix)


def table_bytes(root: Path, name: str, table: str, suffix: str) -> bytes:
    """See `view.table_bytes`."""
    from benchtool.web.runs import view

    return view.table_bytes(root, name, table, suffix)
