"""Fit and read fits, in processes of their own: what `benchtool fit --out` does and prints."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchtool.core.column_source import ColumnSource
from benchtool.core.errors import InputError
from benchtool.data.atomic import replace_text, write_atomically
from benchtool.data.column_map import column_map_to_toml
from benchtool.data.formats.formats import is_stand_table
from benchtool.data.run.runs_folder import RunsFolder, columns_file
from benchtool.data.table import read_table
from benchtool.fit.recipe import Recipe
from benchtool.fit.uncertainty.budget import BudgetMethod
from benchtool.web.jobs import PageSection, ReportProgress
from benchtool.web.uploads import stand_blocks


def fit_to_folder(
    report: ReportProgress,
    out: Path,
    words: tuple[str, ...],
    recipe: Recipe,
    profile: bool = False,
    budget: BudgetMethod = "propagation",
) -> str:
    """Run a recipe, write its folder in one step, and return the folder's name.

    Raises:
        BenchtoolError: the data or the model do not allow the fit.
    """
    from benchtool.fit.run_recipe import run_recipe
    from benchtool.report.fit.page import refuse_full, write_fit

    refuse_full(out)
    report("reading", 0.0)

    def progress(what: str, done: int, expected: int) -> None:
        report(what, done / max(expected, 1))

    output = run_recipe(recipe, progress, profile=profile, budget=budget)
    report("drawing", 0.0)
    with write_atomically(out) as part:
        write_fit(part, output, [shlex.join(["benchtool", *words])])
    return out.name


def view_fit(root: Path, name: str) -> PageSection:
    """Return what `benchtool fit` prints of a stored fit, and its figures."""
    from benchtool.report.figure import captions
    from benchtool.report.fit.stored_fit import SIMULATED, figure_files, read_stored
    from benchtool.report.page import Paragraph
    from benchtool.web.drawing import FigureImage, blocks_html

    path = RunsFolder(root).path_of(name)
    stored = read_stored(path)
    blocks = [block for block in stored.blocks if block != Paragraph(SIMULATED)]
    warnings, rest = blocks[-1], blocks[1:-1]
    known = captions("fit")
    figures = [
        FigureImage(file.read_bytes(), known[key]) for key, file in figure_files(path).items()
    ]
    return PageSection(
        title=name,
        html=blocks_html([blocks[0], warnings, *figures[:1], *rest, *figures[1:]]),
        simulated=stored.simulated,
        command=("report", str(path)),
    )


def stand_summary_html(root: Path, name: str) -> str:
    """Return what an import finds in a stand's table as HTML; empty for any other table."""
    from benchtool.web.drawing import blocks_html

    return blocks_html(stand_blocks(RunsFolder(root).file_of(name)))


def store_radius(root: Path, name: str, radius_m: float | None) -> Path:
    """Write a rig of a radius alone for a table, and return its file.

    Raises:
        InputError: neither a radius is given nor does the table state one.
        WouldOverwrite: there is one already.
    """
    from benchtool.commands.terminal.table_fit import radius_rig
    from benchtool.core.rig_file import parse_rig

    folder = RunsFolder(root)
    table = folder.file_of(name)
    text = radius_rig(str(table), radius_m, known=is_stand_table(table))
    if not text:
        raise InputError(f"{name} does not say how large the rotor is; type its radius")
    parse_rig(text, f"rig of {name}")
    path = folder.new_path(f"{table.stem}.rig.toml")
    replace_text(path, text)
    return path


def store_columns(root: Path, name: str, columns: Mapping[str, ColumnSource]) -> str:
    """Read a table through a map, store the map beside it, and return what was read as HTML.

    Raises:
        FileFormatError: a cell that is no number, with its line; nothing was stored.
    """
    from benchtool.report.page import Paragraph, Table
    from benchtool.web.drawing import blocks_html

    path = RunsFolder(root).file_of(name)
    recording = read_table(path, columns)
    rows = []
    for channel in recording.channels:
        values = recording.column(channel.name)
        known = values[np.isfinite(values)]
        least, most = (known.min(), known.max()) if known.size else (np.nan, np.nan)
        rows.append((channel.name, channel.unit, str(known.size), f"{least:.4g}", f"{most:.4g}"))
    replace_text(columns_file(path), column_map_to_toml(columns))
    head = ("channel", "unit", "numbers", "least", "most")
    repairs = recording.provenance["repairs"]
    return blocks_html(
        [
            Table(f"{len(recording)} rows as they will be fitted.", head, rows, text_columns=2),
            *([Paragraph(f"Repaired while reading: {repairs}.")] if repairs else []),
        ]
    )
