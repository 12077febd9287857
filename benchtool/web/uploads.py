"""Import of uploaded files, as `benchtool import`; runs in a worker process."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from benchtool.data.run.runs_folder import RunsFolder, create_table_path, store_table, upload_name

if TYPE_CHECKING:
    from benchtool.commands.import_file import ImportInputs
    from benchtool.data.repairs.import_result import ImportResult
    from benchtool.report.page import Block


def store_upload(root: Path, name: str, data: bytes, date: str, inputs: ImportInputs) -> str:
    """Store a file in the runs folder and return its name there.

    A table is stored unchanged and repaired when it is read; a flight log, or a file with import
    options, is converted to a recording.

    Raises:
        FileFormatError: the file is not readable; nothing was written.
    """
    from benchtool.data.formats.formats import detect_format, import_bytes
    from benchtool.data.repairs.import_result import ImportOptions, import_metadata
    from benchtool.data.run.recording_file import write_recording

    folder, options, file_format = RunsFolder(root), inputs.options(), detect_format(data)
    if options == ImportOptions() and (file_format is None or file_format.kind == "table"):
        return folder.relative_name(store_table(folder, name, data, date))
    result = import_bytes(data, upload_name(name), options)
    path = create_table_path(folder, name, date)
    write_recording(path, result.recording, import_metadata(result, options))
    return folder.relative_name(path)


def stand_blocks(path: Path) -> Sequence[Block]:
    """Return the import report of a test-stand table; empty for other tables."""
    from benchtool.data.formats.formats import import_file, is_stand_table

    return import_blocks(import_file(path)) if is_stand_table(path) else ()


def import_blocks(result: ImportResult) -> Sequence[Block]:
    """Return the import report: format, channels with their columns, and findings."""
    from benchtool.report.page import Paragraph, Table

    tally = result.tally
    counts = f"{tally.kept} of {tally.total} {tally.unit}s accepted, {tally.refused} rejected."
    channels = [(channel.name, result.sources.get(channel.name, ""), channel.unit)
                for channel in result.recording.channels]  # fmt: skip
    blocks: list[Block] = [
        Paragraph(f"Format: {result.format}. {counts}"),
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
