"""Files that are handed over to the page, in a process of its own: what `benchtool import` does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from benchtool.data.run.runs_folder import RunsFolder, new_table, shown_name, store_table

if TYPE_CHECKING:
    from benchtool.commands.import_file import ImportInputs
    from benchtool.data.repairs.import_result import ImportResult
    from benchtool.report.page import Block


def store_upload(root: Path, name: str, data: bytes, date: str, given: ImportInputs) -> str:
    """Store a file in the runs folder and return its name there.

    A table is stored as it is, and read with its repairs wherever it is used; a log of a flight, or
    a file with options of the import, becomes a recording.

    Raises:
        FileFormatError: it cannot be read; nothing was written.
    """
    from benchtool.data.formats.formats import detect_format, import_bytes
    from benchtool.data.repairs.import_result import ImportOptions, import_metadata
    from benchtool.data.run.recording_file import write_recording

    folder, options, found = RunsFolder(root), given.options(), detect_format(data)
    if options == ImportOptions() and (found is None or found.kind == "table"):
        return folder.name_of(store_table(folder, name, data, date))
    read = import_bytes(data, shown_name(name), options)
    path = new_table(folder, name, date)
    write_recording(path, read.recording, import_metadata(read, options))
    return folder.name_of(path)


def stand_blocks(path: Path) -> Sequence[Block]:
    """Return what an import finds in a stand's table; nothing for any other table."""
    from benchtool.data.formats.formats import import_file, is_stand_table

    return import_blocks(import_file(path)) if is_stand_table(path) else ()


def import_blocks(read: ImportResult) -> Sequence[Block]:
    """Return what an import read: its format, which column is which channel, its findings."""
    from benchtool.report.page import Paragraph, Table

    tally = read.tally
    kept = f"{tally.kept} of {tally.total} {tally.unit}s are kept, {tally.refused} refused."
    channels = [(item.name, read.sources.get(item.name, ""), item.unit)
                for item in read.recording.channels]  # fmt: skip
    blocks: list[Block] = [
        Paragraph(f"Read as {read.format}: {kept}"),
        Table("What is read.", ("channel", "column [unit]", "unit"), channels, text_columns=3),
    ]
    if read.findings:
        found = [
            (one.kind, one.what, one.channel, f"{one.words} (line {one.lines[:40]})"
             if one.lines else one.words)
            for one in read.findings
        ]  # fmt: skip
        head = ("kind", "what", "channel", "words")
        blocks.append(Table("What the import found.", head, found, text_columns=4))
    return blocks
