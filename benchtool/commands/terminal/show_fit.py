"""Terminal output of a fit: progress, values, warnings and comparison."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from rich.progress import TextColumn, TimeRemainingColumn

from benchtool.commands.terminal.tables import Output, print_table, progress_bar
from benchtool.fit.run_recipe import FitSummary
from benchtool.report.fit.page import terminal_blocks
from benchtool.report.fit.tables import value_cells, wanted_rank
from benchtool.report.page import Table, Warnings

MAX_COLUMNS = 5  # of a table on a terminal


@contextmanager
def progress_status() -> Iterator[Callable[[str, int, int], None]]:
    """Yield a progress callback: a bar on a terminal, no output otherwise."""
    counts = TextColumn("{task.completed:.0f}/{task.total:.0f}")
    with progress_bar(counts, TimeRemainingColumn()) as bar:
        task = bar.add_task("reading", total=1)

        def report(stage: str, done: int, expected: int) -> None:
            bar.update(task, description=stage, completed=done, total=max(expected, 1))

        yield report


def print_fit(fit: FitSummary) -> None:
    """Print the sections of a fit report."""
    console = Output()
    for section in terminal_blocks(fit):
        if isinstance(section, Table):
            width = max(MAX_COLUMNS, section.text_columns + 3)
            print_table(console, section.select_columns(range(min(width, len(section.header)))))
        elif isinstance(section, Warnings):
            console.print_lines(*(f"! {line}" for line in section.sentences))
        elif isinstance(section, str):
            console.print_lines(section)


def print_runs(fits: Mapping[str, FitSummary]) -> None:
    """Print a table with one row per run."""
    first = next(iter(fits.values())).results[0]
    names = [item.name for item in (*first.estimates, *first.derived)]
    names.sort(key=lambda name: (wanted_rank(name), name.startswith("noise.")))
    names = names[: MAX_COLUMNS - 2]
    rows = [
        (run, *value_cells(fit.results[0], names), f"{fit.results[0].chi2_per_dof:.3g}")
        for run, fit in fits.items()
    ]
    head = ("run", *names, "chi2/dof")
    print_table(Output(), Table("Separate fits: value ± standard uncertainty.", head, rows))
