"""Show a fit on the terminal: progress while it works, then values, warnings, comparison."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Literal

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from benchtool.core.fit_result import FitResult
from benchtool.recipes.fit_page import comparison_table, sentence
from benchtool.recipes.run_recipe import FitOutput
from benchtool.report import page
from benchtool.report.fit_tables import methods_table, short_table

FILE_WIDTH = 110
"""Width of tables where no terminal gives one: room for the longest parameter names."""


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
    if output.data.points.simulated:
        console.print("SIMULATED DATA: no physical bench produced these points")
    console.print(sentence(output), markup=False)
    for result in output.results:
        print_table(console, short_table(result))
        console.print(f"{result.method}: {result.outcome.message}", markup=False)
    if len(output.results) > 1:
        print_table(console, methods_table(output.results))
    if output.comparison is not None:
        console.print(output.comparison.sentence, markup=False)
        print_table(console, _narrow(comparison_table(output.comparison)))
    for line in _warnings(output.results):
        console.print(f"! {line}", markup=False)


def _narrow(table: page.Table) -> page.Table:
    """Return the columns of a comparison that a terminal has room for."""
    kept = [0, 1, 2, 3, 4]
    return page.Table(
        table.caption,
        [table.header[column] for column in kept],
        [[row[column] for column in kept] for row in table.rows],
        text_columns=2,
    )


def _warnings(results: tuple[FitResult, ...]) -> list[str]:
    return list(dict.fromkeys(line for result in results for line in result.warnings))


def print_table(console: Console, shown: page.Table) -> None:
    """Print a table of the report on a terminal."""
    table = Table(title=shown.caption, title_justify="left", box=SIMPLE_HEAD)
    for position, head in enumerate(shown.header):
        justify: Literal["left", "right"] = "left" if position < shown.text_columns else "right"
        table.add_column(head, justify=justify, overflow="fold")
    for row in shown.rows:
        table.add_row(*row)
    console.print(table)
