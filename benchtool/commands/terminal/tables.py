"""Consoles, tables and progress bars, as every command shows them."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from typing import Any, Literal, TextIO

from rich.box import SIMPLE_HEAD
from rich.console import Console, ConsoleOptions, RenderableType
from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from benchtool.core.errors import show_controls
from benchtool.report import page

FILE_WIDTH = 120  # width where no terminal gives one: room for the longest parameter names


class EscapedConsole(Console):
    """Console that escapes its texts, not its styles, and writes behind an `EscapedStream`."""

    def __init__(self, stream: TextIO | None = None, **options: Any) -> None:
        stream = stream or sys.stdout
        while (behind := getattr(stream, "rich_proxied_file", None)) is not None:
            stream = behind
        super().__init__(file=stream, **options)

    def render(
        self, renderable: RenderableType, options: ConsoleOptions | None = None
    ) -> Iterable[Segment]:
        for segment in super().render(renderable, options):
            text = segment.text if segment.control else show_controls(segment.text)
            yield segment._replace(text=text)


class Output(EscapedConsole):
    """A console of whole lines that leaves it to its caller what a closed pipe means."""

    def __init__(self) -> None:
        super().__init__(soft_wrap=True, highlight=False)
        if not self.is_terminal:
            self.width = FILE_WIDTH

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError

    def say(self, *lines: str) -> None:
        """Print lines as they are, whatever brackets stand in them."""
        for line in lines:
            self.print(line, markup=False)


def print_table(console: Console, shown: page.Table) -> None:
    """Print a table of the report on a terminal."""
    table = Table(title=Text(shown.caption), title_justify="left", box=SIMPLE_HEAD)
    for position, head in enumerate(shown.header):
        justify: Literal["left", "right"] = "left" if position < shown.text_columns else "right"
        table.add_column(Text(head), justify=justify, overflow="fold")
    for row in shown.rows:
        table.add_row(*(Text(show_controls(cell)) for cell in row))
    console.print(table)


def progress_bar(*columns: ProgressColumn, transient: bool = True) -> Progress:
    """Return a bar that shows on a terminal and nowhere else."""
    console = EscapedConsole(sys.stderr)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        *columns,
        console=console,
        transient=transient,
        disable=not console.is_terminal,
    )
