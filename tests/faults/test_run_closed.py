"""A run whose program died, or stopped behind its last point, is closed by whoever needs it."""

from __future__ import annotations

import json
import os
import shutil
import signal
from pathlib import Path

import pytest

from benchtool.data.run.append import read_events
from benchtool.data.run.read import read_samples
from benchtool.data.run.run import Run, read_settings
from tests.faults.loop import ADDRESS, Outcome, World, command, plan, sweep

pytestmark = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")


def in_ramp_down(world: World) -> bool:
    return "stopping" in world.proxy.seen.phases


@pytest.fixture(scope="module")
def dead_run(tmp_path_factory):
    """Return the folder of a run whose process was killed when all was measured."""
    folder = tmp_path_factory.mktemp("dead")

    def kill(world: World) -> None:
        if in_ramp_down(world):
            os.kill(os.getpid(), signal.SIGKILL)

    pid = os.fork()
    if not pid:
        sweep(folder, plan("1.36", 0.5), [], hooks=[kill])
        os._exit(0)
    _, status = os.waitpid(pid, 0)
    assert os.waitstatus_to_exitcode(status) == -signal.SIGKILL
    run = folder / "run"
    assert Run.open(run).metadata["state"] == "running"
    assert not (run / "settings.csv").exists()
    assert not (run / "samples.parquet").exists()
    return run


@pytest.fixture
def dead(dead_run, tmp_path):
    shutil.copytree(dead_run, tmp_path / "run")
    return tmp_path / "run"


def closed(run: Path, *words: str) -> Outcome:
    return command([*words, "run"], run.parent, World([]))


def require_closed(run: Path, state: str = "ended") -> None:
    facts = Run.open(run).metadata
    assert facts["state"] == state
    assert facts["samples"].keys() == {"parquet_sha256", "csv_sha256"}
    assert len(read_settings(run)) == 1
    assert read_samples(run).provenance["file"].endswith("samples.parquet")
    assert not list(run.glob(".*"))


def test_runs_close_closes_it_once(dead):
    (dead / ".metadata.json.99999.new").write_text("half")
    outcome = closed(dead, "runs", "close")
    assert (outcome.code, outcome.last_line) == (0, "run: closed; ended")
    require_closed(dead)
    assert read_events(dead / "events.jsonl")[-1].event == "closed"
    before = {path.name: path.read_bytes() for path in dead.iterdir()}
    again = closed(dead, "runs", "close")
    assert (again.code, again.last_line) == (0, "run: already closed; ended")
    assert {path.name: path.read_bytes() for path in dead.iterdir()} == before


def test_resuming_it_closes_it(dead):
    outcome = closed(dead, "sweep", ADDRESS, "--yes", "--resume")
    assert outcome.code == 2
    assert outcome.last_line == (
        "nothing to resume in run: all visits are measured (1 visit); it has now been closed"
    )
    require_closed(dead)
    outcome = closed(dead, "sweep", ADDRESS, "--yes", "--resume")
    assert outcome.last_line.endswith("all visits are measured (1 visit)")


def test_a_reader_of_settings_closes_it(dead):
    assert len(read_settings(dead)) == 1
    require_closed(dead)


def test_a_run_without_its_number_of_visits_is_closed_by_its_plan(dead):
    facts = json.loads((dead / "metadata.json").read_text())
    assert facts.pop("visits") == 1
    (dead / "metadata.json").write_text(json.dumps(facts))
    assert closed(dead, "runs", "close").code == 0
    require_closed(dead)


def test_one_that_died_before_its_last_point_is_stopped(dead):
    points = dead / "points.csv"
    points.write_text("\n".join(points.read_text().split("\n")[:2]) + "\n")
    outcome = closed(dead, "runs", "close")
    assert "run: closed; stopped (the program that measured it ended" in outcome.said
    assert not (dead / "settings.csv").exists()
    assert (dead / "samples.parquet").exists()
    assert closed(dead, "sweep", ADDRESS, "--yes", "--resume").code == 0
    require_closed(dead)


def test_ctrl_c_behind_the_last_point_leaves_it_ended_once_closed(tmp_path):
    pressed: list[float] = []

    def press(world: World) -> None:
        if in_ramp_down(world) and not pressed:
            pressed.append(world.now_s)
            signal.raise_signal(signal.SIGINT)

    outcome = sweep(tmp_path, plan("1.36", 0.5), [], hooks=[press])
    assert pressed
    assert outcome.code == 5
    assert len(outcome.points()) == 1
    assert "check the reason of the stop, then continue with: benchtool fit run" in (outcome.said)
    assert "--resume" not in outcome.said
    closed(tmp_path / "run", "runs", "close")
    require_closed(tmp_path / "run")


def test_a_run_that_is_being_measured_is_not_closed(tmp_path):
    said: list[str] = []

    def close(world: World) -> None:
        if "sampling" in world.proxy.seen.phases and not said:
            pid = os.fork()
            if not pid:
                outcome = closed(tmp_path / "run", "runs", "close")
                (tmp_path / "said").write_text(f"{outcome.code} {outcome.last_line}")
                os._exit(0)
            os.waitpid(pid, 0)
            said.append((tmp_path / "said").read_text())

    assert sweep(tmp_path, plan("1.36", 0.5), [], hooks=[close]).code == 0
    assert said == ["2 the run run is in use by another process; wait until that process ends"]
    require_closed(tmp_path / "run")
