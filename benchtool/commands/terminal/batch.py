"""Many recordings, each by itself: in processes of this machine or on a cluster, stored as done."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any, TypeVar

from rich.progress import MofNCompleteColumn, TimeRemainingColumn

from benchtool.commands.terminal.tables import progress_bar
from benchtool.core.errors import BenchtoolError, EstimationError, InputError
from benchtool.data.atomic import partial_folder, write_atomically
from benchtool.report.fit.page import refuse_full
from benchtool.tasks import TaskStore, Work, run_tasks

T = TypeVar("T")

Written = Callable[[Path], Any]  # writes everything into a folder


def index_by_name(data: Sequence[str]) -> dict[str, str]:
    """Return data by the last part of their path.

    Raises:
        InputError: two have one name.
    """
    names = [Path(each).name if Path(each).is_dir() else Path(each).stem for each in data]
    if again := next((name for name in names if names.count(name) > 1), ""):
        both = " and ".join(each for name, each in zip(names, data, strict=True) if name == again)
        raise InputError(f"{both} would both be called {again}; rename one of them")
    return dict(zip(names, data, strict=True))


def run_each(
    work: Work[T],
    tasks: Mapping[str, T],
    *,
    out: Path | None,
    about: Mapping[str, str],
    cluster: str | None,
    processes: int | None = None,
) -> dict[str, Any]:
    """Return the result of each task by name, in their order, and show how many are done.

    Args:
        work: `outcome` of something that writes its folder with `reject_duplicate_outputs`.
        out: folder of their folders; with it, what was ended goes on when it is called again.
        about: of which work these are results.

    Raises:
        WouldOverwrite: the folder holds something else already.
    """
    path = None if out is None else out / "done.jsonl"
    if out is not None and path is not None and not path.exists():
        refuse_full(out)
    columns = (MofNCompleteColumn(), TimeRemainingColumn())
    found = {}
    with (
        progress_bar(*columns) as bar,
        nullcontext() if path is None else TaskStore(path, about) as store,
    ):
        shown = bar.add_task("done", total=len(tasks))
        options: dict[str, Any] = {"store": store, "cluster": cluster, "processes": processes}
        try:
            for name, result in run_tasks(work, tasks, **options):
                found[name] = result
                bar.update(shown, completed=len(found))
        except KeyboardInterrupt:
            if path is not None:
                print(f"ended; what is done is in {out}; the same command resumes", file=sys.stderr)
            raise
    if path is not None:
        path.unlink()
    return {name: found[name] for name in tasks}


def reject_duplicate_outputs(folder: Path | None, write: Written) -> None:
    """Write a folder whole; one that is there was, by a task whose result was not stored."""
    if folder is not None and not folder.exists():
        partial_folder(folder).parent.mkdir(parents=True, exist_ok=True)
        with write_atomically(folder) as part:
            write(part)


def outcome(work: Callable[[T], Any], item: T) -> dict[str, Any]:
    """Return what work returns as `result`, or its error as sentence and exit code.

    What is wrong with one recording ends no other.
    """
    try:
        return {"result": work(item), "error": "", "exit_code": 0}
    except BenchtoolError as error:
        return {"result": None, "error": str(error), "exit_code": error.exit_code}


def raise_first(found: Mapping[str, Mapping[str, Any]]) -> None:
    """Print the errors of all outcomes, and raise the first as the end of the command."""
    wrong = {name: one for name, one in found.items() if one["error"]}
    for name, one in wrong.items():
        print(f"! {name}: {one['error']}")
    for name, one in wrong.items():
        kind = EstimationError if one["exit_code"] == EstimationError.exit_code else InputError
        raise kind(f"{len(wrong)} of {len(found)} failed, the first is {name}: {one['error']}")
