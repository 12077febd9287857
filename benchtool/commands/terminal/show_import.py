"""Terminal output of an import: summary and table of findings."""

from __future__ import annotations

from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from benchtool.commands.terminal.tables import Output
from benchtool.data.repairs.import_result import ImportResult


def print_import(result: ImportResult, target: Path | None) -> None:
    """Print one import."""
    console = Output()
    tally = result.tally
    parts = [f"{tally.kept:,} of {tally.total:,} {tally.unit}s kept"]
    if tally.not_needed:
        parts.append(f"{tally.not_needed:,} of other kinds")
    parts.append(f"{tally.refused:,} rejected")
    source = result.recording.provenance.get("file", "")
    console.print_lines(f"{source}: {result.format}; {', '.join(parts)}")
    console.print_lines(f"channels: {', '.join(result.recording.names)}")
    for window in result.windows:
        rotor = f"rotor {window.rotor}" if window.rotor else "all rotors"
        console.print_lines(
            f"over a surface: {rotor}, {window.start_s:.6g} s to {window.end_s:.6g} s "
            f"(source: {window.source})"
        )
    if result.findings:
        console.print(_table(result))
    if target is not None:
        console.print_lines(f"written: {target} and {target.name}.json")


def _table(result: ImportResult) -> Table:
    table = Table(box=SIMPLE_HEAD)
    table.add_column("kind", no_wrap=True)
    table.add_column("finding", overflow="fold", max_width=18)
    table.add_column("channel", overflow="fold", max_width=16)
    table.add_column("details", overflow="fold")
    for finding in result.findings:
        lines = finding.lines if len(finding.lines) <= 40 else f"{finding.lines[:36]} ..."
        details = f"{finding.words} (line {lines})" if finding.lines else finding.words
        table.add_row(*map(Text, (finding.kind, finding.what, finding.channel, details)))
    return table
