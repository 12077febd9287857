"""Many tasks at once: every result once, whoever ends, and errors with their own sentence."""

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


def square_noted(notes: Path, n: int) -> int:
    with notes.open("a") as file:
        file.write(f"{n}\n")
    return n * n


def die_once(notes: Path, n: int) -> int:
    """End the process at 3, the first time."""
    if n == 3 and not notes.exists():
        notes.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return n * n


def die(n: int) -> int:
    os.kill(os.getpid(), signal.SIGKILL)
    return n


def refuse(n: int) -> int:
    if n == 2:
        raise UnknownChoice("number", "two", ["one"])
    return n


@pytest.mark.parametrize("processes", [0, 2])
def test_every_task_gives_its_result(processes):
    assert dict(run_tasks(square, ITEMS, processes=processes)) == SQUARES


def test_what_is_stored_is_not_run_again(tmp_path):
    path, notes = tmp_path / "store.jsonl", tmp_path / "notes"
    work = partial(square_noted, notes)
    with TaskStore(path, ABOUT) as store:
        running = run_tasks(work, ITEMS, store=store, processes=0)
        assert [next(running) for _ in range(3)] == [("0", 0), ("1", 1), ("2", 4)]
    path.write_bytes(path.read_bytes()[:-4])  # a kill has torn the last line
    with TaskStore(path, ABOUT) as store:
        assert dict(run_tasks(work, ITEMS, store=store, processes=0)) == SQUARES
        assert [store[name] for name in reversed(ITEMS)] == [25, 16, 9, 4, 1, 0]
    assert notes.read_text().split() == ["0", "1", "2", "2", "3", "4", "5"]


def test_a_store_of_other_work_is_refused(tmp_path):
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
        found = list(
            run_tasks(partial(die_once, tmp_path / "notes"), ITEMS, store=store, processes=2)
        )
    assert sorted(found) == sorted(SQUARES.items())


def test_processes_that_die_again_and_again_are_one_sentence():
    with pytest.raises(ResourceExhausted, match="processes ended 3 times before any of 6 tasks"):
        list(run_tasks(die, ITEMS, processes=2))


@pytest.mark.parametrize("processes", [0, 2])
def test_an_error_of_a_task_keeps_its_class_and_its_sentence(processes):
    with pytest.raises(UnknownChoice, match="two"):
        list(run_tasks(refuse, ITEMS, processes=processes))


def test_no_scheduler_is_said_before_anything_is_run(tmp_path):
    pytest.importorskip("distributed", reason="no Dask: pip install benchtool[cluster]")
    for address in ("tcp://127.0.0.1:1", "nonsense", "tcp://127.0.0.1:99999999"):
        with pytest.raises(InputError, match="no Dask scheduler at"):
            list(run_tasks(square, ITEMS, cluster=address))
