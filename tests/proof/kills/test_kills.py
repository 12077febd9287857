"""Kills and power cuts at calls drawn at random; `make kills` takes every one."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from random import Random

import pytest

from benchtool.data.run.read import read_points
from benchtool.data.run.run import Run
from tests.faults.loop import ADDRESS, World, command
from tests.proof.kills.commands import FAST, KILLED, RUN, Left, check_run
from tests.proof.kills.disk import Disk, read_tree, recorded, write_tree
from tests.proof.kills.states import check_all, tape

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs POSIX")


@pytest.mark.parametrize(
    ("name", "some"),
    [
        ("sweep", 6),
        ("close", None),
        *(pytest.param(name, 6, marks=pytest.mark.slow, id=f"{name}-more") for name in KILLED),
    ],
)
def test_nothing_is_lost_and_everything_closes(tmp_path, name, some):
    of = tape(KILLED[name], tmp_path)
    count = check_all(of, some)
    assert count.changes >= min(some or 10**9, len(of.changes) + 1)
    assert not count.failed, "\n".join(count.failed)


@pytest.mark.slow
def test_a_killed_process_leaves_what_the_disk_says(tmp_path):
    of = tape(KILLED["sweep"], tmp_path)
    for at in sorted(Random(2).sample(range(len(of.changes)), 6)):
        root = tmp_path / str(at)
        root.mkdir()
        disk = Disk()
        write_tree(root, of.before)
        for change in of.changes[:at]:
            disk.apply(change)
        pid = os.fork()
        if not pid:
            with recorded(root, lambda number, at=at: os._exit(9) if number == at else None):  # type: ignore[misc]
                KILLED["sweep"].run(root)
            os._exit(0)
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 9
        assert shape(read_tree(root)) == shape(disk.after_kill() | of.before)


def shape(tree: dict[str, bytes | None]) -> dict[str, int | bytes | None]:
    """Return a tree without the times of day and the process numbers in it."""
    return {
        re.sub(r"(stop/|\.)[\da-f-]+\.(new|json)", r"\1\2", name): data
        if name.endswith(".csv")
        else data and len(data)
        for name, data in tree.items()
    }


@pytest.mark.slow
def test_a_killed_sweep_goes_on(tmp_path):
    of = tape(KILLED["sweep"], tmp_path)
    begun = [at for at, change in enumerate(of.changes) if b"sample," in change.data]
    disk, chosen = Disk(), set(Random(3).sample(begun, 3))
    for at, change in enumerate(of.changes):
        if at in chosen:
            root = tmp_path / str(at)
            root.mkdir()
            write_tree(root, disk.after_kill())
            resumed = command(["sweep", ADDRESS, "--yes", "--resume", RUN], root, World([], FAST))
            assert resumed.code == 0, resumed.said
            assert Run.open(root / RUN).metadata["state"] == "ended"
            assert len(read_points(root / RUN)) == 2
        disk.apply(change)


WORDS = ("sweep", "sim:pquad_single", "--z-over-r", "1,2", "--pwm", "1450", "--repeats", "1",
         "--sample-s", "0.5", "--yes", "--out", RUN)  # fmt: skip
CALLS = ("openat", "write", "fsync", "rename", "mkdir", "unlink", "close", "fstat", "lseek")


def straced(root: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Sweep in a process of its own under strace."""
    root.mkdir()
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1", "BENCHTOOL_STATE": str(root / "s")}
    line = ["strace", "-f", "-qq", *options, sys.executable, "-m", "benchtool", *WORDS]
    return subprocess.run(line, cwd=root, env=environment, capture_output=True, text=True)


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("strace") is None, reason="strace is not installed")
def test_a_real_process_killed_by_strace_leaves_a_run_that_closes(tmp_path):
    assert kill_by_strace(tmp_path, 4) == 4


def kill_by_strace(
    folder: Path, some: int, skip: int = 0, note: Callable[[bool], None] = lambda _: None
) -> int:
    """Kill a sweep at system calls drawn at random from the first that names the run on.

    They are those of the main thread, as strace counts the calls of each thread by themselves.

    Args:
        skip: so many of them were killed before.
        note: called with whether a process was killed.

    Returns:
        How many of the processes were killed; each left whole rows and a run that closes.
    """
    listed = straced(folder / "whole", "-e", f"trace={','.join(CALLS)}", "-o", "trace")
    assert listed.returncode == 0, listed.stderr
    seen: Counter[str] = Counter()
    calls, begun = [], False
    lines = (folder / "whole/trace").read_text().splitlines()
    main_thread = lines[0].split()[0]
    for line in lines:
        called = re.match(rf"{main_thread} +(\w+)\(", line)
        if called and called[1] in CALLS:
            seen[called[1]] += 1
            begun = begun or ('"runs' in line and called[1] == "mkdir")
            if begun:
                calls.append((called[1], seen[called[1]]))
    print(f"{len(calls)} system calls of {', '.join(CALLS)} from the first that names the run on")
    killed = 0
    for call, number in Random(0).sample(calls, some)[skip:]:
        root = folder / f"{call}-{number}"
        inject = f"inject={call}:signal=SIGKILL:when={number}"
        ended = straced(root, "-e", f"trace={call}", "-e", inject, "-o", "/dev/null")
        killed += ended.returncode != 0
        left = read_tree(root)
        check_run(Left(root, ended.stdout, left, left, {}, power=False))
        print(f"{call} {number}: exit code {ended.returncode}", flush=True)
        note(ended.returncode != 0)
    return killed
