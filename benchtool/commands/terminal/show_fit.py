"""Show a fit on the terminal: progress while it works, then values, warnings, comparison."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from rich.progress import TextColumn, TimeRemainingColumn

from benchtool.commands.terminal.tables import Output, print_table, progress_bar
from benchtool.fit.run_recipe import FitOutput
from benchtool.report.fit.stored_fit import stored
from benchtool.report.page import Paragraph, Table, Warnings

WIDEST = 5
"""Columns of a table that a terminal has room for."""


@contextmanager
def working() -> Iterator[Callable[[str, int, int], None]]:
    """Show a bar on a terminal, nothing elsewhere; gives the function that moves it."""
    counts = TextColumn("{task.completed:.0f}/{task.total:.0f}")
    with progress_bar(counts, TimeRemainingColumn()) as bar:
        task = bar.add_task("reading", total=1)

        def report(what: str, done: int, expected: int) -> None:
            bar.update(task, description=what, completed=done, total=max(expected, 1))

        yield report


def print_fit(output: FitOutput) -> None:
    """Print what a fit found."""
    console = Output()
    for block in stored(output).blocks:
        if isinstance(block, Table):
            print_table(console, block.narrowed(range(min(WIDEST, len(block.header)))))
        elif isinstance(block, Warnings):
            console.say(*(f"! {line}" for line in block.sentences))
        elif isinstance(block, Paragraph):
            console.say(block.text)


def print_runs(outputs: Mapping[str, FitOutput]) -> None:
    """Print the fits of several runs of one table beside each other."""
    first = next(iter(outputs.values())).results[0]
    names = [item.name for item in (*first.estimates, *first.derived)][: WIDEST - 2]
    rows = []
    for run, output in outputs.items():
        result = output.results[0]
        known = {item.name: item for item in (*result.estimates, *result.derived)}
        values = [
            f"{known[name].value:.4g} ± {known[name].sd:.2g}" if name in known else "–"
            for name in names
        ]
        rows.append((run, *values, f"{result.chi2_per_dof:.3g}"))
    head = ("run", *names, "chi2/dof")
    print_table(Output(), Table("Each run by itself, ± one standard deviation.", head, rows))
