"""Show what an import found: one line of what was read, then a table of findings."""

from __future__ import annotations

from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from benchtool.commands.terminal.tables import Output
from benchtool.data.repairs.import_result import ImportResult


def print_import(read: ImportResult, target: Path | None) -> None:
    """Print one import."""
    console = Output()
    tally = read.tally
    parts = [f"{tally.kept:,} of {tally.total:,} {tally.unit}s kept"]
    if tally.not_needed:
        parts.append(f"{tally.not_needed:,} of kinds that are not needed")
    parts.append(f"{tally.refused:,} refused")
    source = read.recording.provenance.get("file", "")
    console.say(f"{source}: {read.format}; {', '.join(parts)}")
    console.say(f"channels: {', '.join(read.recording.names)}")
    for window in read.windows:
        rotor = f"rotor {window.rotor}" if window.rotor else "all rotors"
        console.say(
            f"over a surface: {rotor}, {window.start_s:.6g} s to {window.end_s:.6g} s "
            f"(says {window.source})"
        )
    if read.findings:
        console.print(_table(read))
    if target is not None:
        console.say(f"written: {target} and {target.name}.json")


def _table(read: ImportResult) -> Table:
    table = Table(box=SIMPLE_HEAD)
    table.add_column("kind", no_wrap=True)
    table.add_column("what", overflow="fold", max_width=18)
    table.add_column("channel", overflow="fold", max_width=16)
    table.add_column("words", overflow="fold")
    for item in read.findings:
        lines = item.lines if len(item.lines) <= 40 else f"{item.lines[:36]} ..."
        words = f"{item.words} (line {lines})" if item.lines else item.words
        table.add_row(*map(Text, (item.kind, item.what, item.channel, words)))
    return table
