"""Consoles, tables and progress bars, as every command shows them."""

from __future__ import annotations

from typing import Literal

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, Progress, ProgressColumn, TextColumn
from rich.table import Table
from rich.text import Text

from benchtool.report import page

FILE_WIDTH = 120
"""Width where no terminal gives one: room for the longest parameter names."""


class Output(Console):
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
        table.add_row(*map(Text, row))
    console.print(table)


def progress_bar(*columns: ProgressColumn, transient: bool = True) -> Progress:
    """Return a bar that shows on a terminal and nowhere else."""
    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        *columns,
        console=console,
        transient=transient,
        disable=not console.is_terminal,
    )
