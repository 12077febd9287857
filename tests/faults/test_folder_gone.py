"""The run folder goes in mid-run: zero at once, and all that was measured is saved elsewhere."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from benchtool.data.run.append import read_events
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import Run
from tests.faults.loop import ADDRESS, Outcome, World, command, plan, sweep

NOBODY = 65534


@contextmanager
def user_without_rights() -> Iterator[None]:
    try:
        yield
    finally:
        if hasattr(os, "geteuid") and os.getuid() == 0:
            os.seteuid(0)


def move(run: Path) -> None:
    run.rename(run.with_name("elsewhere"))


def replace(run: Path) -> None:
    move(run)
    shutil.copytree(run.with_name("elsewhere"), run)


def forbid(run: Path) -> None:
    run.parent.chmod(0o777)
    run.chmod(0o555)
    if os.getuid() == 0:  # root could write there all the same
        if not all(path.stat().st_mode & 0o001 for path in Path(__file__).parents):
            pytest.skip("root becomes another user here, who may not enter the project's folder")
        os.seteuid(NOBODY)


def delete_samples(run: Path) -> None:
    (run / "samples.csv").unlink()


def struck(folder: Path, strike: Callable[[Path], None]) -> tuple[Outcome, float]:
    """Sweep two visits, strike in the second, and return what came of it and when."""
    at_s: list[float] = []

    def hook(world: World) -> None:
        points = folder / "run/points.csv"
        if at_s or not points.exists() or points.read_text().count("\n") < 3:
            return
        if world.pulses[-1][1] == 1500.0:
            at_s.append(world.now_s)
            strike(folder / "run")

    with user_without_rights():
        outcome = sweep(folder, plan("1.36, 1.34", 1.0), [], hooks=[hook])
    assert at_s, outcome.said
    return outcome, at_s[0]


@pytest.mark.parametrize(
    ("strike", "said", "code"),
    [
        (shutil.rmtree, "it was deleted or moved", 5),
        (move, "it was deleted or moved", 5),
        (replace, "was replaced by another folder", 5),
        (
            lambda run: (run / "samples.csv").unlink(),
            "samples.csv was deleted, moved or replaced",
            5,
        ),
        (forbid, "was made read-only", 10),
    ],
    ids=["deleted", "moved", "replaced", "samples deleted", "read-only"],
)
def test_a_folder_that_goes_ends_the_run_and_is_rescued(tmp_path, strike, said, code):
    outcome, at_s = struck(tmp_path, strike)
    assert outcome.code == code, outcome.said
    zero_s = min(s for s, us in outcome.pulses if s > at_s and us <= 1000.0)
    assert zero_s - at_s < 0.15
    assert outcome.orders_to_turn_after(zero_s) == []
    assert said in outcome.last_line
    assert "the recorded data are saved in run-rescued" in outcome.last_line
    assert "resume with: benchtool sweep --resume run-rescued" in outcome.said
    saved = tmp_path / "run-rescued"
    facts = Run.open(saved).metadata
    assert (facts["state"], facts["rescued_from"]) == ("stopped", "run")
    assert said in facts["reason"]
    assert [event.event for event in read_events(saved / "events.jsonl")][-1] == "stopped"
    assert len(read_points(saved)) == 1
    # Every sample that was sent is there, up to those after the stop.
    samples = read_samples(saved)
    assert len(samples) == facts["link"]["samples"]
    assert samples.column("pwm1_us")[-1] == 1000.0
    if strike is replace:  # the copy is as the stranger left it
        assert outcome.metadata["state"] == "running"
    if strike is move:
        rows = (tmp_path / "elsewhere/samples.csv").read_text()
        assert (saved / "samples.csv").read_text() == rows


def test_a_rescued_run_is_gone_on_with(tmp_path):
    struck(tmp_path, shutil.rmtree)
    (tmp_path / "run-rescued").rename(tmp_path / "run")
    resumed = command(["sweep", ADDRESS, "--resume", "run", "--yes"], tmp_path, World([]))
    assert resumed.code == 0, resumed.said
    assert len(resumed.points()) == 2
