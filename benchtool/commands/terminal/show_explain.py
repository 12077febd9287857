"""Show an explanation on the terminal: progress while it works, then the answer."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeElapsedColumn

from benchtool.commands.terminal.show_fit import FILE_WIDTH, print_table
from benchtool.explain.answer import Answer
from benchtool.explain.next_steps import lines, next_file, next_sentence, next_steps
from benchtool.report.answer.added_words import added_sentence, changes
from benchtool.report.answer.folder import ANSWER, PAGE
from benchtool.report.answer.page import where_sentence
from benchtool.report.answer.tables import (
    short_effects_table,
    short_gap_table,
    tolerances_table,
    unjudged_sentence,
)


@contextmanager
def working(reading: str) -> Iterator[Callable[[str, float], None]]:
    """Show a bar on a terminal, one line elsewhere; gives the function that moves the bar.

    Args:
        reading: the recordings.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeElapsedColumn(),
    )
    shown = sys.stderr.isatty()
    begun = f"explaining {reading}; the answer can take a minute or more"
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=not shown) as bar:
        task = bar.add_task("reading", total=1.0)

        def tell(what: str, share: float) -> None:
            nonlocal begun
            if begun and not shown:  # what is refused never comes here, and ends in one sentence
                print(begun, file=sys.stderr, flush=True)
            begun = ""
            bar.update(task, description=what, completed=share)

        yield tell


class Pipe(Console):
    """A console that leaves it to its caller what a closed pipe means."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError


@contextmanager
def for_a_reader() -> Iterator[None]:
    """Print as long as somebody reads: `head` closing the pipe is no error."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        # What is still in the buffer must not be tried again when the process ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def print_answer(answer: Answer) -> None:
    """Print what was found: the sentence, where, which, the gap, tolerances, what is not judged."""
    console = _console()
    verdict = answer.verdict
    if answer.simulated:
        console.print("SIMULATED DATA: no physical bench produced these recordings")
    _print_verdict(console, answer)
    console.print(where_sentence(answer), markup=False)
    if verdict.effects:
        print_table(console, short_effects_table(answer))
    print_table(console, short_gap_table(answer))
    print_table(console, tolerances_table(answer))
    for name in verdict.not_judged:
        console.print(f"Not judged: {name} {unjudged_sentence(answer, name)}", markup=False)
    for line in answer.remarks:
        console.print(f"! {line}", markup=False)
    console.print(f"It took {answer.seconds:.1f} s.", markup=False)


def _print_verdict(console: Console, answer: Answer) -> None:
    console.print(answer.verdict.sentence, markup=False)
    if answer.caution:
        console.print(answer.caution, markup=False)


def print_next(answer: Answer, out: Path | None, json_file: Path | None) -> None:
    """Print in one place: the verdict, what was added to which file, and the next commands."""
    console = _console()
    folder = str(out) if out is not None else ""
    if out is not None:
        print(f"written: {out / PAGE}, the figures and {ANSWER} beside it")
    if json_file is not None:
        print(f"written: {json_file}")
    console.print("\nIn short", style="bold")
    _print_verdict(console, answer)
    console.print(added_sentence(answer, folder), markup=False)
    for change in changes(answer):
        console.print(f"  {change.words}", markup=False)
    if to_do := next_sentence(answer):
        name, _ = next_file(answer)
        stands = f" It stands in {out / name}." if out is not None and name else ""
        console.print(f"{to_do}{stands}", markup=False)
    if out is None:
        print("add --out FOLDER for the page, the figures, the new model and the next experiment")
    for line in lines(next_steps(answer, folder)):
        console.print(line, markup=False)


def _console() -> Console:
    console = Pipe(soft_wrap=True, highlight=False)
    if not console.is_terminal:
        console.width = FILE_WIDTH
    return console
