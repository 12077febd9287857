"""What reaches the disk first: samples before the point made of them, and folders, too."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from benchtool.data.run.run import Run
from tests.faults.loop import plan, sweep

pytestmark = pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="needs /proc")


def test_points_are_forced_to_the_disk_behind_their_samples(tmp_path, monkeypatch):
    write, fsync = os.write, os.fsync
    waiting: dict[str, int] = {}
    forced: list[str] = []

    def name_of(handle: int) -> str:
        return os.readlink(f"/proc/self/fd/{handle}").removeprefix(f"{tmp_path}/")

    def counted(handle: int, data: bytes) -> int:
        waiting[name_of(handle)] = waiting.get(name_of(handle), 0) + len(data)
        return write(handle, data)

    def watched(handle: int) -> None:
        name = name_of(handle)
        if name == "run/points.csv":
            assert waiting.get("run/samples.csv", 0) == 0
        forced.append(name)
        waiting[name] = 0
        fsync(handle)

    monkeypatch.setattr(os, "write", counted)
    monkeypatch.setattr(os, "fsync", watched)
    outcome = sweep(tmp_path, plan("1.36, 1.34", 0.5), [])
    assert outcome.code == 0, outcome.said
    assert forced.count("run/points.csv") >= 4
    assert str(tmp_path) in forced
    # The folder's own entries: plan and metadata, then the files that grow.
    first, second = [i for i, name in enumerate(forced) if name == "run/points.csv"][:2]
    assert "run" in forced[first:second]
    assert {"run/samples.csv", "run/.samples.parquet.new"} <= set(forced)


def test_a_folder_that_was_never_begun_does_not_block_its_name(tmp_path):
    run = Run.create(tmp_path / "run", "", {"state": "running"})
    run.event_log().close()
    (run.path / ".metadata.json.1.new").write_text("")
    outcome = sweep(tmp_path, plan("1.36", 0.5), [])
    assert outcome.code == 0, outcome.said
    assert not list(run.path.glob(".*"))
    before = (run.path / "points.csv").read_bytes()
    outcome = sweep(tmp_path, plan("1.36", 0.5), [])
    assert outcome.code == 2
    assert "run exists already" in outcome.last_line
    assert (run.path / "points.csv").read_bytes() == before
