"""Where a run goes on: what it has, what it lacks, and whether this is its bench."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchtool.acquire.experiment import Experiment
from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.plan import plan_from_toml, plan_to_toml
from benchtool.acquire.record import LinkQuality
from benchtool.acquire.resume import (
    SweepStart,
    close_run,
    load_resume_state,
    prepare_resume,
    require_same_device,
)
from benchtool.bench.bench import DeviceInfo
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.columns import word_to_code
from benchtool.data.run.read import read_samples
from benchtool.data.run.run import Run
from benchtool.data.run.run_writer import RunWriter
from tests.unit.acquire.fake_bench import FakeBench
from tests.unit.data.run_of import CHANNELS, point

RIG = load_rig_by_name("pquad_single")
PLAN = plan_from_toml(
    """
repeats = 2
[plate]
distances_m = [0.1]
[throttle]
pwm_us = [1400.0]
[order]
references = false
anchor_every = 0
""",
    "plan",
).resolved(RIG)
LINK = {"lost": 5, "corrupt": 3, "repeated": 2}


class Begun(Experiment):
    def describe_run(self, identity: DeviceInfo) -> tuple[str, str, dict[str, Any]]:
        return "sweep", plan_to_toml(PLAN), {"link": LINK}


def begun(path: Path, done: int = 1, rows: int = 4) -> Run:
    """Return a run of two visits: with the points of some, and samples of the park and of both."""
    run = Begun(SweepInputs(out=path), RIG).create_run(FakeBench().identity)
    samples = run.sample_writer(CHANNELS)
    time_s = 0.5 * np.arange(rows)
    for number, phase in ((0, "move"), (1, "sample"), (2, "settle")):
        values = np.full((rows, 3), 1400.0)
        samples.append(number, phase, time_s + 2.0 * number, 1e6 * time_s, values)
    samples.close()
    points = run.point_writer(1)
    points.append(point(0, "tare", 0, 0, 0.0))
    for number in range(1, done + 1):
        measured = point(number, "measure", 1, number, 1.0)
        points.append(replace(measured, settled=number != 1, suspect=number == 1))
    points.close()
    return run


def test_a_run_goes_on_behind_what_it_has(tmp_path):
    run = begun(tmp_path / "run")
    rest = load_resume_state(run)
    assert (rest.done, rest.remaining, rest.stage, rest.calibration) == (
        frozenset({1}),
        1,
        None,
        None,
    )
    assert (rest.plan, rest.rig.name) == (PLAN, RIG.name)
    # The last sample is at 5.5 s, and 1 s stands for the break.
    link = LinkQuality(12, **LINK)
    assert prepare_resume(rest) == SweepStart(
        frozenset({1}), 6.5, unsettled=1, suspect=1, tares=1, link=link
    )
    RunWriter(run, CHANNELS, 1).close()
    found = read_samples(run.path)
    words = ["move"] * 4 + ["sample"] * 4 + ["interrupted"] * 4
    assert found.column("phase").tolist() == [word_to_code("phase", word) for word in words]


def test_a_run_of_which_nothing_was_measured_begins_anew(tmp_path):
    run = begun(tmp_path / "run", done=0, rows=0)
    assert prepare_resume(load_resume_state(run)) == SweepStart()
    (run.path / "points.csv").unlink()
    assert load_resume_state(run).remaining == 2


def test_a_run_that_counted_no_losses_begins_with_none(tmp_path):
    run = begun(tmp_path / "run", done=0)
    run.update_metadata(link=None)
    assert prepare_resume(load_resume_state(run)) == SweepStart(
        time_s=6.5, tares=1, link=LinkQuality(12)
    )


def test_what_was_counted_is_that_of_the_visits_of_the_plan(tmp_path):
    run = begun(tmp_path / "run")
    points = run.point_writer(1)
    points.append(replace(point(9, "measure", 1, 9, 1.0), settled=False, suspect=True))
    points.close()
    behind = SweepStart(
        frozenset({1}), 6.5, unsettled=1, suspect=1, tares=1, link=LinkQuality(12, **LINK)
    )
    assert prepare_resume(load_resume_state(run)) == behind
    path = run.path / "points.csv"
    rows = [line.split(",") for line in path.read_text().splitlines()]
    column = rows[0].index("suspect")  # which earlier versions did not write
    path.write_text("".join(",".join(row[:column] + row[column + 1 :]) + "\n" for row in rows))
    assert prepare_resume(load_resume_state(run)) == replace(behind, suspect=0)
    path.unlink()
    assert prepare_resume(load_resume_state(run)) == SweepStart(time_s=6.5, link=behind.link)


@pytest.mark.parametrize("name", ["distances_m", "pwm_us"])
def test_a_plan_that_does_not_state_its_grid_is_refused(tmp_path, name):
    run = begun(tmp_path / "run")
    plan = run.path / "plan.toml"
    plan.write_text(re.sub(rf"(?ms)^{name} = \[.*?\]$", "", plan.read_text()))
    with pytest.raises(FileFormatError, match=r"plan\.toml.*distances_m or throttle\.pwm_us is"):
        load_resume_state(run)


def test_where_nothing_is_left_the_run_is_closed_once(tmp_path):
    run = begun(tmp_path / "run", done=2)
    said = "nothing to resume in .*: all visits are measured \\(2 visits\\)"
    with pytest.raises(InputError, match=f"{said}; it has now been closed$"):
        prepare_resume(load_resume_state(run))
    assert run.metadata["state"] == "ended"
    with pytest.raises(InputError, match=f"{said}$"):
        prepare_resume(load_resume_state(run))


def test_a_visit_whose_line_was_cut_is_not_done(tmp_path):
    run = begun(tmp_path / "run", done=2)
    path = run.path / "points.csv"
    path.write_bytes(path.read_bytes()[:-1])
    assert load_resume_state(run).done == frozenset({1})


@pytest.mark.parametrize("kind", ["tare", "failed"])
def test_points_that_measured_nothing_are_no_visits(tmp_path, kind):
    run = begun(tmp_path / "run", done=0)
    points = run.point_writer(1)
    points.append(point(1, kind, 0, 0, 0.0))
    points.close()
    assert load_resume_state(run).remaining == 2


def test_a_line_that_cannot_be_read_is_no_visit_to_measure_again(tmp_path):
    run = begun(tmp_path / "run")
    with open(run.path / "points.csv", "a") as file:
        file.write("2,measure,x\n")
    with pytest.raises(FileFormatError, match=r"points\.csv"):
        load_resume_state(run)


def test_another_device_is_refused(tmp_path):
    rest = load_resume_state(begun(tmp_path / "run"))
    identity = FakeBench().identity
    require_same_device(rest, identity)
    with pytest.raises(InputError, match="was started on device 'fake-1', but fake:1 is 'other'"):
        require_same_device(rest, replace(identity, device_id="other"))


@pytest.mark.parametrize(
    ("facts", "plan", "state"),
    [
        ({"visits": 2}, "", "ended"),
        ({}, plan_to_toml(PLAN), "ended"),
        ({}, plan_to_toml(PLAN).replace("repeats = 2", "repeats = 3"), "stopped"),
        ({"experiment": "pitch"}, "no plan of a sweep", "stopped"),
    ],
)
def test_a_run_of_any_kind_is_closed(tmp_path, facts, plan, state):
    run = begun(tmp_path / "run", done=2)
    run.update_metadata(**facts)
    (run.path / "plan.toml").write_text(plan)
    assert close_run(run)
    assert run.metadata["state"] == state
    assert not close_run(run)
