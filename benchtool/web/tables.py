"""Tables of the runs folder: upload, import report, column map and radius; in worker processes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from benchtool.core.channel import ColumnSource
from benchtool.core.errors import InputError
from benchtool.data.atomic import replace_text
from benchtool.data.column_map import column_map_to_toml
from benchtool.data.formats.formats import detect_format, import_bytes, import_file, is_stand_table
from benchtool.data.run.runs_folder import (
    RunsFolder,
    column_map_path,
    create_table_path,
    store_table,
    upload_name,
)
from benchtool.data.table import read_table
from benchtool.web.drawing import Content, PageSection

if TYPE_CHECKING:
    from benchtool.commands.import_file import ImportInputs


def store_upload(root: Path, name: str, data: bytes, date: str, inputs: ImportInputs) -> str:
    """Store a file in the runs folder and return its name there, as `benchtool import`.

    A table is stored unchanged and repaired when it is read; a flight log, or a file with import
    options, is converted to a recording.

    Raises:
        FileFormatError: the file is not readable; nothing was written.
    """
    from benchtool.data.repairs.import_result import ImportOptions, import_metadata
    from benchtool.data.run.recording_file import write_recording

    folder, options, file_format = RunsFolder(root), inputs.options(), detect_format(data)
    if options == ImportOptions() and (file_format is None or file_format.kind == "table"):
        return folder.relative_name(store_table(folder, name, data, date))
    result = import_bytes(data, upload_name(name), options)
    path = create_table_path(folder, name, date)
    write_recording(path, result.recording, import_metadata(result, options))
    return folder.relative_name(path)


def stand_blocks(path: Path) -> Sequence[Content]:
    """Return the import report of a test-stand table: format, channels and findings.

    Empty for other tables.
    """
    from benchtool.report.page import Table

    if not is_stand_table(path):
        return ()
    result = import_file(path)
    tally = result.tally
    counts = f"{tally.kept} of {tally.total} {tally.unit}s accepted, {tally.refused} rejected."
    channels = [(channel.name, result.sources.get(channel.name, ""), channel.unit)
                for channel in result.recording.channels]  # fmt: skip
    blocks: list[Content] = [
        f"Format: {result.format}. {counts}",
        Table("Channels.", ("channel", "column [unit]", "unit"), channels, text_columns=3),
    ]
    if result.findings:
        rows = [
            (item.kind, item.what, item.channel, f"{item.words} (line {item.lines[:40]})"
             if item.lines else item.words)
            for item in result.findings
        ]  # fmt: skip
        header = ("kind", "finding", "channel", "description")
        blocks.append(Table("Findings of the import.", header, rows, text_columns=4))
    return blocks


def view_import(root: Path, name: str) -> PageSection:
    """Return the import report of a test-stand table; empty for other tables."""
    return PageSection.draw(name, stand_blocks(RunsFolder(root).find_file(name)))


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


def store_columns(root: Path, name: str, columns: Mapping[str, ColumnSource]) -> PageSection:
    """Read a table with a column map, store the map next to it and return a summary.

    Raises:
        FileFormatError: a cell is not a number; nothing was stored.
    """
    from benchtool.report.page import Table

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
    table = Table(f"{len(recording)} rows for the fit.", header, rows, text_columns=2)
    return PageSection.draw(name, [table, f"Repairs: {repairs}."] if repairs else [table])
