"""Batch of independent tasks in worker processes or on a cluster, with stored results."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from rich.progress import MofNCompleteColumn, TimeRemainingColumn

from benchtool.commands.terminal.tables import progress_bar
from benchtool.core.errors import BenchtoolError, EstimationError, InputError
from benchtool.data.atomic import partial_folder, write_atomically
from benchtool.report.fit.page import refuse_full
from benchtool.tasks import TaskStore, run_tasks

T = TypeVar("T")


def index_by_name(data: Sequence[str]) -> dict[str, str]:
    """Return data paths by folder name or file stem.

    Raises:
        InputError: two paths have the same name.
    """
    names = [Path(path).name if Path(path).is_dir() else Path(path).stem for path in data]
    if duplicate := next((name for name in names if names.count(name) > 1), ""):
        pairs = zip(names, data, strict=True)
        paths = " and ".join(path for name, path in pairs if name == duplicate)
        raise InputError(f"{paths} have the same name {duplicate}; rename one")
    return dict(zip(names, data, strict=True))


def run_each(
    work: Callable[[T], Any],
    tasks: Mapping[str, T],
    *,
    out: Path | None,
    about: Mapping[str, str],
    cluster: str | None,
    processes: int | None = None,
) -> dict[str, Any]:
    """Return the outcome of each task by name, in order, with a progress bar.

    An outcome has the result or None, the error or "", and its exit code.

    Args:
        work: writes its folder with `write_folder_once`; an error of one task does not stop the
            others.
        out: parent of the task folders; an interrupted batch resumes there.
        about: description that identifies the work.

    Raises:
        WouldOverwrite: the folder contains other files.
    """
    path = None if out is None else out / "done.jsonl"
    if out is not None and path is not None and not path.exists():
        refuse_full(out)
    columns = (MofNCompleteColumn(), TimeRemainingColumn())
    results = {}
    with (
        progress_bar(*columns) as bar,
        nullcontext() if path is None else TaskStore(path, about) as store,
    ):
        task_id = bar.add_task("done", total=len(tasks))
        options: dict[str, Any] = {"store": store, "cluster": cluster, "processes": processes}
        try:
            for name, result in run_tasks(partial(_outcome, work), tasks, **options):
                results[name] = result
                bar.update(task_id, completed=len(results))
        except KeyboardInterrupt:
            if path is not None:
                print(f"stopped; results are in {out}; the same command resumes", file=sys.stderr)
            raise
    if path is not None:
        path.unlink()
    return {name: results[name] for name in tasks}


def write_folder_once(folder: Path | None, write: Callable[[Path], Any]) -> None:
    """Write a folder atomically; skip one that an interrupted run has already written."""
    if folder is not None and not folder.exists():
        partial_folder(folder).parent.mkdir(parents=True, exist_ok=True)
        with write_atomically(folder) as temporary:
            write(temporary)


def _outcome(work: Callable[[T], Any], item: T) -> dict[str, Any]:
    try:
        return {"result": work(item), "error": "", "exit_code": 0}
    except BenchtoolError as error:
        return {"result": None, "error": str(error), "exit_code": error.exit_code}


def raise_first(outcomes: Mapping[str, Mapping[str, Any]]) -> None:
    """Print the errors of all outcomes, and raise the first."""
    failed = {name: row for name, row in outcomes.items() if row["error"]}
    for name, row in failed.items():
        print(f"! {name}: {row['error']}")
    for name, row in failed.items():
        is_estimation = row["exit_code"] == EstimationError.exit_code
        error_class = EstimationError if is_estimation else InputError
        raise error_class(f"{len(failed)} of {len(outcomes)} failed, first {name}: {row['error']}")
