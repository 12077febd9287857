"""Say on the terminal what a report is busy with."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn


@contextmanager
def working(words: str) -> Iterator[Callable[[str], None]]:
    """Show what is done, and for how long; give what tells the next thing.

    Where no terminal is, the first words are written once.
    """
    console = Console(stderr=True, highlight=False)
    if not console.is_terminal:
        console.print(f"{words} ...", markup=False, soft_wrap=True)
        yield lambda _: None
        return
    columns = (SpinnerColumn(), TextColumn("{task.description}", markup=False), TimeElapsedColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(words, total=None)
        yield lambda text: bar.update(task, description=f"{words}: {text}")
