"""Terminal output of an explanation: progress and answer."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.progress import TaskProgressColumn, TimeElapsedColumn

from benchtool.commands.terminal.tables import Output, print_table, progress_bar
from benchtool.explain.next_steps import format_steps, next_file, next_sentence, next_steps
from benchtool.explain.result import Explanation
from benchtool.report.answer.folder import ANSWER
from benchtool.report.answer.page import added_sentence, changes, where_sentence
from benchtool.report.answer.tables import (
    short_effects_table,
    short_gap_table,
    tolerances_table,
    unjudged_sentence,
)
from benchtool.report.page import PAGE


@contextmanager
def progress_status(recordings: str) -> Iterator[Callable[[str, float], None]]:
    """Yield a progress callback: a bar on a terminal, one line otherwise."""
    start_line = f"explaining {recordings}; this can take a minute or more"
    with progress_bar(TaskProgressColumn(), TimeElapsedColumn()) as bar:
        task = bar.add_task("reading", total=1.0)

        def report(stage: str, fraction: float) -> None:
            nonlocal start_line
            if start_line and bar.disable:  # after all inputs are checked
                print(start_line, file=sys.stderr, flush=True)
            start_line = ""
            bar.update(task, description=stage, completed=fraction)

        yield report


@contextmanager
def ignore_broken_pipe() -> Iterator[None]:
    """Ignore a broken pipe, for example of `head`, and flush standard output."""
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:
        # The remaining buffer must not be written again at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def print_answer(answer: Explanation) -> None:
    """Print verdict, location, effects, gap, tolerances, unjudged effects and warnings."""
    console = Output()
    if answer.simulated:
        console.print("SIMULATED DATA: no physical bench produced these recordings")
    _print_verdict(console, answer)
    console.print_lines(where_sentence(answer))
    if answer.effects:
        print_table(console, short_effects_table(answer))
    print_table(console, short_gap_table(answer))
    print_table(console, tolerances_table(answer))
    for name in answer.not_judged:
        console.print_lines(
            f"Not judged: {answer.find_title(name)} {unjudged_sentence(answer, name)}"
        )
    console.print_lines(*(f"! {line}" for line in answer.remarks))
    console.print_lines(f"Computing time: {answer.seconds:.1f} s.")


def _print_verdict(console: Output, answer: Explanation) -> None:
    console.print_lines(answer.sentence)
    if answer.caution:
        console.print_lines(answer.caution)


def print_next(answer: Explanation, out: Path | None, json_file: Path | None) -> None:
    """Print the written files, the verdict, model changes and next commands."""
    console = Output()
    folder = str(out) if out is not None else ""
    if out is not None:
        print(f"written: {out / PAGE}, figures and {ANSWER} in the same folder")
    if json_file is not None:
        print(f"written: {json_file}")
    console.print("\nIn short", style="bold")
    _print_verdict(console, answer)
    console.print_lines(added_sentence(answer, folder))
    console.print_lines(*(f"  {change.words}" for change in changes(answer)))
    if sentence := next_sentence(answer):
        name, _ = next_file(answer)
        location = f" File: {out / name}." if out is not None and name else ""
        console.print_lines(f"{sentence}{location}")
    if out is None:
        print("add --out FOLDER for the report, figures, new model and next experiment")
    console.print_lines(*format_steps(next_steps(answer, folder)))
