"""Fits in worker processes, as `benchtool fit --out`, and views of stored fits."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from benchtool.core.channel import ColumnSource
from benchtool.core.choices import BudgetMethod
from benchtool.core.errors import InputError
from benchtool.data.atomic import replace_text, write_atomically
from benchtool.data.column_map import column_map_to_toml
from benchtool.data.formats.formats import is_stand_table
from benchtool.data.run.runs_folder import RunsFolder, column_map_path
from benchtool.data.table import read_table
from benchtool.fit.recipe import Recipe
from benchtool.web.jobs import PageSection, ReportProgress
from benchtool.web.uploads import stand_blocks


def fit_to_folder(
    report: ReportProgress,
    out: Path,
    command: tuple[str, ...],
    recipe: Recipe,
    profile: bool = False,
    budget: BudgetMethod = "propagation",
) -> str:
    """Run a recipe, write its folder atomically and return the folder's name."""
    from benchtool.fit.run_recipe import run_recipe
    from benchtool.report.fit.page import refuse_full, write_fit

    refuse_full(out)
    report("reading", 0.0)

    def progress(stage: str, done: int, expected: int) -> None:
        report(stage, done / max(expected, 1))

    output = run_recipe(recipe, progress, profile=profile, budget=budget)
    report("drawing", 0.0)
    with write_atomically(out) as folder:
        write_fit(folder, output, [shlex.join(["benchtool", *command])])
    return out.name


def view_fit(root: Path, name: str) -> PageSection:
    """Return the result of a stored fit, as printed by `benchtool fit`, with its figures."""
    from benchtool.fit.result_file import read_fit
    from benchtool.report.figure import captions
    from benchtool.report.fit.page import SIMULATED, figure_files, terminal_blocks
    from benchtool.report.page import Paragraph
    from benchtool.web.drawing import FigureImage, blocks_html

    path = RunsFolder(root).find_path(name)
    stored = read_fit(path)
    blocks = [block for block in terminal_blocks(stored) if block != Paragraph(SIMULATED)]
    warnings, tables = blocks[-1], blocks[1:-1]
    texts = captions("fit")
    figures = [
        FigureImage(file.read_bytes(), texts[key]) for key, file in figure_files(path).items()
    ]
    return PageSection(
        title=name,
        html=blocks_html([blocks[0], warnings, *figures[:1], *tables, *figures[1:]]),
        simulated=stored.simulated,
        command=("report", str(path)),
    )


def stand_summary_html(root: Path, name: str) -> str:
    """Return the import report of a test-stand table as HTML; "" for other tables."""
    from benchtool.web.drawing import blocks_html

    return blocks_html(stand_blocks(RunsFolder(root).find_file(name)))


def store_radius(root: Path, name: str, radius_m: float | None) -> Path:
    """Write a rig file with the rotor radius for a table and return its path."""
    from benchtool.commands.terminal.table_fit import build_radius_rig
    from benchtool.core.rig_file import parse_rig

    folder = RunsFolder(root)
    table = folder.find_file(name)
    text = build_radius_rig(str(table), radius_m, is_stand=is_stand_table(table))
    if not text:
        raise InputError(f"{name} contains no rotor radius; type one in m")
    parse_rig(text, f"rig of {name}")
    path = folder.new_path(f"{table.stem}.rig.toml")
    replace_text(path, text)
    return path


def store_columns(root: Path, name: str, columns: Mapping[str, ColumnSource]) -> str:
    """Read a table with a column map, store the map next to it and return a summary as HTML.

    Raises:
        FileFormatError: a cell is not a number; nothing was stored.
    """
    from benchtool.report.page import Paragraph, Table
    from benchtool.web.drawing import blocks_html

    path = RunsFolder(root).find_file(name)
    recording = read_table(path, columns)
    rows = []
    for channel in recording.channels:
        values = recording.column(channel.name)
        finite = values[np.isfinite(values)]
        low, high = (finite.min(), finite.max()) if finite.size else (np.nan, np.nan)
        rows.append((channel.name, channel.unit, str(finite.size), f"{low:.4g}", f"{high:.4g}"))
    replace_text(column_map_path(path), column_map_to_toml(columns))
    header = ("channel", "unit", "values", "minimum", "maximum")
    repairs = recording.provenance["repairs"]
    return blocks_html(
        [
            Table(f"{len(recording)} rows for the fit.", header, rows, text_columns=2),
            *([Paragraph(f"Repairs: {repairs}.")] if repairs else []),
        ]
    )
