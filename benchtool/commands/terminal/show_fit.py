"""Show a fit on the terminal: progress while it works, then values, warnings, comparison."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

from rich.progress import TextColumn, TimeRemainingColumn

from benchtool.commands.terminal.tables import Output, print_table, progress_bar
from benchtool.report.fit.stored_fit import StoredFit
from benchtool.report.fit.tables import printed, wanted_rank
from benchtool.report.page import Paragraph, Table, Warnings

WIDEST = 5  # columns of a table that a terminal has room for


@contextmanager
def progress_status() -> Iterator[Callable[[str, int, int], None]]:
    """Show a bar on a terminal, nothing elsewhere; gives the function that moves it."""
    counts = TextColumn("{task.completed:.0f}/{task.total:.0f}")
    with progress_bar(counts, TimeRemainingColumn()) as bar:
        task = bar.add_task("reading", total=1)

        def report(what: str, done: int, expected: int) -> None:
            bar.update(task, description=what, completed=done, total=max(expected, 1))

        yield report


def print_fit(fit: StoredFit) -> None:
    """Print what a fit found."""
    console = Output()
    for block in fit.blocks:
        if isinstance(block, Table):
            width = max(WIDEST, block.text_columns + 3)
            print_table(console, block.narrowed(range(min(width, len(block.header)))))
        elif isinstance(block, Warnings):
            console.say(*(f"! {line}" for line in block.sentences))
        elif isinstance(block, Paragraph):
            console.say(block.text)


def print_runs(fits: Mapping[str, StoredFit]) -> None:
    """Print the fits of several runs beside each other."""
    first = next(iter(fits.values())).results[0]
    names = [item.name for item in (*first.estimates, *first.derived)]
    names.sort(key=lambda name: (wanted_rank(name), name.startswith("noise.")))
    names = names[: WIDEST - 2]
    rows = []
    for run, fit in fits.items():
        result = fit.results[0]
        known = {item.name: item for item in (*result.estimates, *result.derived)}
        values = [printed(known[name]) if name in known else "–" for name in names]
        rows.append((run, *values, f"{result.chi2_per_dof:.3g}"))
    head = ("run", *names, "chi2/dof")
    print_table(Output(), Table("Each run by itself: value ± standard uncertainty.", head, rows))
