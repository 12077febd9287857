"""Plans without a plate: throttle alone, on a bench with or without a stage."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from benchtool.acquire.check_plan import check_plan
from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.operator import Unattended
from benchtool.acquire.plan import (
    THROTTLE_TESTS,
    OrderPart,
    Plan,
    PlatePart,
    ThrottlePart,
    read_plan,
)
from benchtool.acquire.session import run_experiment
from benchtool.acquire.visit_order import expected_duration_s, plan_visits
from benchtool.core.errors import InputError
from benchtool.core.rig_file import load_rig_by_name, rig_names
from benchtool.core.user_code import check_code_allowed
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import Run

SHORT = Plan(
    repeats=2,
    sample_s=0.5,
    plate=PlatePart(used=False),
    throttle=ThrottlePart(percent=(20.0, 50.0)),
    order=OrderPart(anchor_every=0),
)


def swept(plan: Plan, out: Path, **inputs: object) -> Run:
    given = SweepInputs(address="sim:pquad_single", plan=plan, out=out, yes=True, **inputs)  # type: ignore[arg-type]
    run = run_experiment(given, Unattended(), check_code_allowed)
    assert run is not None
    return run


@pytest.mark.parametrize("name", THROTTLE_TESTS)
def test_a_shipped_test_keeps_the_limits_of_every_rig(name):
    for rig_name in rig_names():
        rig = load_rig_by_name(rig_name)
        plan = read_plan(name).resolved(rig)
        check_plan(plan, rig)
        visits = plan_visits(plan, rig)
        assert {visit.kind for visit in visits} == {"reference"}
        assert all(visit.is_parked for visit in visits)


def test_steps_go_up_and_then_down_at_percentages_of_the_pulse_range():
    rig = load_rig_by_name("pquad_single")  # pulses from 1050 to 1950 us
    levels = [visit.level_us for visit in plan_visits(read_plan("steps").resolved(rig), rig)]
    up = [1140.0, 1230.0, 1320.0, 1410.0, 1500.0, 1590.0, 1680.0, 1770.0]
    assert levels == up + up[::-1]
    plan = read_plan("endurance").resolved(rig)
    hour_s = expected_duration_s(plan, rig, plan_visits(plan, rig))
    assert hour_s == pytest.approx(3600.0, rel=0.05)
    ramp = [visit.level_us for visit in plan_visits(read_plan("ramp").resolved(rig), rig)]
    assert ramp == [1140.0, 1770.0] * 2


def test_a_ramp_records_every_sample_on_the_way(tmp_path):
    plan = read_plan("ramp")
    swept(plan, tmp_path / "run")
    pulses_us = read_samples(tmp_path / "run").column("pwm1_us")
    between = np.unique(pulses_us[(pulses_us > 1140.0) & (pulses_us < 1770.0)])
    # 20 s in steps of 50 ms: 400 of 1.575 us, the last of them the end itself.
    assert len(between) >= 399
    assert np.max(np.diff(between)) <= 630.0 / 400.0 + 1e-6


def test_nothing_is_moved_on_a_bench_without_a_stage(tmp_path):
    run = swept(SHORT, tmp_path / "run", stage="none")
    points = read_points(run.path)
    assert len(points) == 4
    assert np.isnan(points.column("plate_stage_z_m")).all()
    assert run.metadata["plate"]["stage"] == "none"
    text = (run.path / "events.jsonl").read_text()
    assert "no plate is moved: throttle alone is visited" in text
    with pytest.raises(InputError, match="--stage none cannot move the plate, but the plan has"):
        swept(Plan(), tmp_path / "other", stage="none")
    assert not (tmp_path / "other").exists()
