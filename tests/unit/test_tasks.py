"""Independent tasks: stored results, crashes and errors."""

from __future__ import annotations

import os
import signal
from functools import partial
from pathlib import Path

import pytest

from benchtool.core.errors import (
    FileFormatError,
    InputError,
    ResourceExhausted,
    UnknownChoice,
)
from benchtool.tasks import TaskStore, run_tasks

ABOUT = {"what": "squares"}
ITEMS = {str(n): n for n in range(6)}
SQUARES = {name: n * n for name, n in ITEMS.items()}


def square(n: int) -> int:
    return n * n


def square_and_log(log: Path, n: int) -> int:
    with log.open("a") as file:
        file.write(f"{n}\n")
    return n * n


def crash_once(log: Path, n: int) -> int:
    """Kill the process at 3, once."""
    if n == 3 and not log.exists():
        log.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return n * n


def crash(n: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return n


def fail(n: int) -> int:
    if n == 2:
        raise UnknownChoice("number", "two", ["one"])
    return n


@pytest.mark.parametrize("processes", [0, 2])
def test_every_task_returns_its_result(processes):
    assert dict(run_tasks(square, ITEMS, processes=processes)) == SQUARES


def test_stored_tasks_are_not_repeated(tmp_path):
    path, log = tmp_path / "store.jsonl", tmp_path / "log"
    work = partial(square_and_log, log)
    with TaskStore(path, ABOUT) as store:
        running = run_tasks(work, ITEMS, store=store, processes=0)
        assert [next(running) for _ in range(3)] == [("0", 0), ("1", 1), ("2", 4)]
    path.write_bytes(path.read_bytes()[:-4])  # an interrupted write
    with TaskStore(path, ABOUT) as store:
        assert dict(run_tasks(work, ITEMS, store=store, processes=0)) == SQUARES
        assert [store[name] for name in reversed(ITEMS)] == [25, 16, 9, 4, 1, 0]
    assert log.read_text().split() == ["0", "1", "2", "2", "3", "4", "5"]


def test_a_store_of_other_work_is_rejected(tmp_path):
    path = tmp_path / "store.jsonl"
    with TaskStore(path, ABOUT) as store:
        store["0"] = 0
        with pytest.raises(InputError, match="another process is writing"):
            TaskStore(path, ABOUT)
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"results of other work \(what differ\)"):
        TaskStore(path, {"what": "cubes"})
    assert path.read_bytes() == before
    path.write_text("no store\n")
    with pytest.raises(FileFormatError, match="not a file of task results"):
        TaskStore(path, ABOUT)
    assert path.read_text() == "no store\n"


def test_a_killed_process_loses_nothing(tmp_path):
    with TaskStore(tmp_path / "store.jsonl", ABOUT) as store:
        results = list(
            run_tasks(partial(crash_once, tmp_path / "log"), ITEMS, store=store, processes=2)
        )
    assert sorted(results) == sorted(SQUARES.items())


def test_repeated_crashes_raise_one_error():
    with pytest.raises(ResourceExhausted, match="processes ended 3 times before any of 6 tasks"):
        list(run_tasks(crash, ITEMS, processes=2))


@pytest.mark.parametrize("processes", [0, 2])
def test_an_error_of_a_task_keeps_class_and_message(processes):
    with pytest.raises(UnknownChoice, match="two"):
        list(run_tasks(fail, ITEMS, processes=processes))


def test_a_missing_scheduler_is_reported_first(tmp_path):
    pytest.importorskip("distributed", reason="no Dask: pip install benchtool[cluster]")
    for address in ("tcp://127.0.0.1:1", "nonsense", "tcp://127.0.0.1:99999999"):
        with pytest.raises(InputError, match="no Dask scheduler at"):
            list(run_tasks(square, ITEMS, cluster=address))
