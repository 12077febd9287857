"""Show a fit on the terminal: progress while it works, then values, warnings, comparison."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Literal

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from benchtool.fit.run_recipe import FitOutput
from benchtool.report import page
from benchtool.report.fit.stored_fit import stored

FILE_WIDTH = 110
"""Width of tables where no terminal gives one: room for the longest parameter names."""

WIDEST = 5
"""Columns of a table that a terminal has room for."""


@contextmanager
def working() -> Iterator[Callable[[str, int, int], None]]:
    """Show a bar on a terminal, nothing elsewhere; gives the function that moves it."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.0f}/{task.total:.0f}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("reading", total=1)

        def tell(what: str, done: int, expected: int) -> None:
            bar.update(task, description=what, completed=done, total=max(expected, 1))

        yield tell


def print_fit(output: FitOutput) -> None:
    """Print what a fit found."""
    console = Console(soft_wrap=True, highlight=False)
    if not console.is_terminal:
        console.width = FILE_WIDTH
    for block in stored(output).blocks:
        if isinstance(block, page.Table):
            print_table(console, _narrow(block))
        elif isinstance(block, page.Warnings):
            for line in block.sentences:
                console.print(f"! {line}", markup=False)
        elif isinstance(block, page.Paragraph):
            console.print(block.text, markup=False)


def _narrow(table: page.Table) -> page.Table:
    """Return the columns of a table that a terminal has room for."""
    if len(table.header) <= WIDEST:
        return table
    return page.Table(
        table.caption,
        table.header[:WIDEST],
        [row[:WIDEST] for row in table.rows],
        text_columns=table.text_columns,
    )


def print_table(console: Console, shown: page.Table) -> None:
    """Print a table of the report on a terminal."""
    table = Table(title=shown.caption, title_justify="left", box=SIMPLE_HEAD)
    for position, head in enumerate(shown.header):
        justify: Literal["left", "right"] = "left" if position < shown.text_columns else "right"
        table.add_column(head, justify=justify, overflow="fold")
    for row in shown.rows:
        table.add_row(*row)
    console.print(table)
