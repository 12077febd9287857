"""What is forced to the disk, and in which order, where a file is changed or replaced."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from benchtool.core.errors import FileFormatError
from benchtool.data.atomic import make_folder, replace_text
from benchtool.data.run.append import (
    AppendFile,
    Event,
    EventLog,
    install_marked_samples,
    write_marked_samples,
)
from benchtool.data.run.run import Run
from tests.unit.data.run_of import CHANNELS, small_run

pytestmark = pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs /proc")


def mark(run: Run) -> None:
    samples = run.path / "samples.csv"
    write_marked_samples(samples, frozenset())
    install_marked_samples(samples)


def log(run: Run) -> None:
    EventLog(run.path / "events.jsonl").append(Event(1.0, "tare", "tared"))


def copied(run: Run) -> None:
    file = AppendFile(run.path / "samples.csv")
    file.copy_to(run.path / "copy", whole=True)
    file.close()


def folders(run: Run) -> None:
    make_folder(run.path / "a" / "b")
    make_folder(run.path / "a" / "b")  # nothing more to do


@pytest.mark.parametrize(
    ("change", "order"),
    [
        (lambda run: replace_text(run.path / "x", "x"), ["fsync .x", "replace .x", "fsync run"]),
        (mark, ["fsync .samples.csv", "replace .samples.csv", "fsync run"]),
        (log, ["fsync events.jsonl"]),
        (lambda run: run.sample_writer(CHANNELS).close(), ["fsync samples.csv"]),
        (copied, ["fsync copy", "fsync samples.csv"]),
        (folders, ["fsync run", "fsync a"]),
    ],
)
def test_a_file_is_on_the_disk_before_its_name_and_its_folder_behind_it(
    tmp_path, monkeypatch, change, order
):
    run = small_run(tmp_path / "run")
    done: list[str] = []
    forced_bytes: dict[int, int] = {}
    fsync, replace = os.fsync, os.replace

    def forced(handle: int) -> None:
        done.append(f"fsync {Path(os.readlink(f'/proc/self/fd/{handle}')).name}")
        there = os.fstat(handle)
        forced_bytes[there.st_ino] = there.st_size
        fsync(handle)

    def renamed(old: Path, new: Path) -> None:
        done.append(f"replace {old.name}")
        replace(old, new)

    monkeypatch.setattr(os, "fsync", forced)
    monkeypatch.setattr(os, "replace", renamed)
    change(run)
    assert [re.sub(r"(\.\d+|\.marked)?\.new$", "", one) for one in done] == order
    for one in filter(Path.is_file, run.path.iterdir()):
        assert forced_bytes.get(one.stat().st_ino, one.stat().st_size) == one.stat().st_size


def test_a_file_that_is_refused_is_closed(tmp_path):
    run = small_run(tmp_path / "run")
    os.mkfifo(run.path / "events.jsonl")
    before = os.listdir("/proc/self/fd")
    with pytest.raises(FileFormatError, match="columns differ from the channels"):
        run.sample_writer(CHANNELS[:2])
    with pytest.raises(FileFormatError, match="not a regular file"):
        run.event_log()
    assert os.listdir("/proc/self/fd") == before
