"""Show an explanation on the terminal: progress while it works, then the answer."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.progress import TaskProgressColumn, TimeElapsedColumn

from benchtool.commands.terminal.tables import Output, print_table, progress_bar
from benchtool.explain.answer import ExplainResult
from benchtool.explain.next_steps import lines, next_file, next_sentence, next_steps
from benchtool.report.answer.folder import ANSWER, PAGE
from benchtool.report.answer.page import added_sentence, changes, where_sentence
from benchtool.report.answer.tables import (
    short_effects_table,
    short_gap_table,
    tolerances_table,
    unjudged_sentence,
)


@contextmanager
def progress_status(reading: str) -> Iterator[Callable[[str, float], None]]:
    """Show a bar on a terminal, one line elsewhere; gives the function that moves the bar."""
    begun = f"explaining {reading}; the answer can take a minute or more"
    with progress_bar(TaskProgressColumn(), TimeElapsedColumn()) as bar:
        task = bar.add_task("reading", total=1.0)

        def report(what: str, share: float) -> None:
            nonlocal begun
            if begun and bar.disable:  # what is refused never comes here, and ends in one sentence
                print(begun, file=sys.stderr, flush=True)
            begun = ""
            bar.update(task, description=what, completed=share)

        yield report


@contextmanager
def is_interactive() -> Iterator[None]:
    """Print as long as somebody reads: `head` closing the pipe is no error."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        # What is still in the buffer must not be tried again when the process ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def print_answer(answer: ExplainResult) -> None:
    """Print what was found: the sentence, where, which, the gap, tolerances, what is not judged."""
    console = Output()
    verdict = answer.verdict
    if answer.simulated:
        console.print("SIMULATED DATA: no physical bench produced these recordings")
    _print_verdict(console, answer)
    console.say(where_sentence(answer))
    if verdict.effects:
        print_table(console, short_effects_table(answer))
    print_table(console, short_gap_table(answer))
    print_table(console, tolerances_table(answer))
    for name in verdict.not_judged:
        console.say(f"Not judged: {answer.title_of(name)} {unjudged_sentence(answer, name)}")
    console.say(*(f"! {line}" for line in answer.remarks))
    console.say(f"It took {answer.seconds:.1f} s.")


def _print_verdict(console: Output, answer: ExplainResult) -> None:
    console.say(answer.verdict.sentence)
    if answer.caution:
        console.say(answer.caution)


def print_next(answer: ExplainResult, out: Path | None, json_file: Path | None) -> None:
    """Print in one place: the verdict, what was added to which file, and the next commands."""
    console = Output()
    folder = str(out) if out is not None else ""
    if out is not None:
        print(f"written: {out / PAGE}, the figures and {ANSWER} beside it")
    if json_file is not None:
        print(f"written: {json_file}")
    console.print("\nIn short", style="bold")
    _print_verdict(console, answer)
    console.say(added_sentence(answer, folder))
    console.say(*(f"  {change.words}" for change in changes(answer)))
    if to_do := next_sentence(answer):
        name, _ = next_file(answer)
        stands = f" It stands in {out / name}." if out is not None and name else ""
        console.say(f"{to_do}{stands}")
    if out is None:
        print("add --out FOLDER for the page, the figures, the new model and the next experiment")
    console.say(*lines(next_steps(answer, folder)))
