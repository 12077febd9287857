"""The jobs of the Runs tab: light to import here, the work is loaded where it is done."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from benchtool.store.export import exported
from benchtool.store.runs_folder import RunsFolder
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


def report_bytes(root: Path, names: Sequence[str]) -> bytes:
    """Return the report of an entry, or of several sweeps, as an HTML file."""
    from benchtool.recipes.report_file import page_text

    folder = RunsFolder(root)
    return page_text([folder.path_of(name) for name in names]).encode("utf-8")


def table_bytes(root: Path, name: str, table: str, suffix: str) -> bytes:
    """Return one table of a run as a CSV or Parquet file."""
    return exported(RunsFolder(root).path_of(name), table, suffix)
