"""Consoles, tables and progress bars of all commands."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Literal, TextIO

from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from benchtool.core.errors import show_controls

if TYPE_CHECKING:
    from benchtool.report import page

FILE_WIDTH = 120  # columns without a terminal; fits the longest parameter names


class EscapedConsole(Console):
    """Console that escapes texts but not styles, and bypasses `EscapedStream`."""

    def __init__(self, stream: TextIO | None = None, **options: Any) -> None:
        stream = stream or sys.stdout
        while (wrapped := getattr(stream, "rich_proxied_file", None)) is not None:
            stream = wrapped
        super().__init__(file=stream, **options)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            text = segment.text if segment.control else show_controls(segment.text)
            yield segment._replace(text=text)


class Output(EscapedConsole):
    """Console without line wrapping; raises BrokenPipeError for a closed pipe."""

    def __init__(self) -> None:
        super().__init__(soft_wrap=True, highlight=False)
        if not self.is_terminal:
            self.width = FILE_WIDTH

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError

    def print_lines(self, *lines: str) -> None:
        """Print lines without markup."""
        for line in lines:
            self.print(line, markup=False)


def print_table(console: Console, report_table: page.Table) -> None:
    """Print a report table on a terminal."""
    table = Table(title=Text(report_table.caption), title_justify="left", box=SIMPLE_HEAD)
    for position, head in enumerate(report_table.header):
        justify: Literal["left", "right"] = (
            "left" if position < report_table.text_columns else "right"
        )
        table.add_column(Text(head), justify=justify, overflow="fold")
    for row in report_table.rows:
        table.add_row(*(Text(show_controls(cell)) for cell in row))
    console.print(table)


def progress_bar(*columns: ProgressColumn, transient: bool = True) -> Progress:
    """Return a progress bar that is visible on a terminal only."""
    console = EscapedConsole(sys.stderr)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        *columns,
        console=console,
        transient=transient,
        disable=not console.is_terminal,
    )
