"""Plans without a plate: throttle alone, on a bench with or without a stage."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import benchtool as bt
from benchtool.acquire.check_plan import check_plan
from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.operator import Unattended
from benchtool.acquire.order import expected_duration_s, visits_of
from benchtool.acquire.plan import (
    THROTTLE_TESTS,
    OrderPart,
    Plan,
    PlatePart,
    ThrottlePart,
    plan_from_toml,
    read_plan,
)
from benchtool.acquire.sweep_run import sweep_to_run
from benchtool.core.errors import FileFormatError, InputError, PlanError, RunStopped, UnknownChoice
from benchtool.core.own_code import refuse_code
from benchtool.core.rig_file import rig_named, rig_names
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import Run
from benchtool.report.page import Table
from benchtool.report.sweep.page import SWEEP
from tests.unit.acquire.interrupted import Interrupted

SHORT = Plan(
    repeats=2,
    sample_s=0.5,
    plate=PlatePart(used=False),
    throttle=ThrottlePart(percent=(20.0, 50.0)),
    order=OrderPart(anchor_every=0),
)


def swept(plan: Plan, out: Path, **inputs: object) -> Run:
    given = SweepInputs(address="sim:pquad_single", plan=plan, out=out, yes=True, **inputs)  # type: ignore[arg-type]
    run = sweep_to_run(given, Unattended(), refuse_code)
    assert run is not None
    return run


@pytest.mark.parametrize("name", THROTTLE_TESTS)
def test_a_shipped_test_keeps_the_limits_of_every_rig(name: str) -> None:
    for rig_name in rig_names():
        rig = rig_named(rig_name)
        plan = read_plan(name).resolved(rig)
        check_plan(plan, rig)
        visits = visits_of(plan, rig)
        assert {visit.kind for visit in visits} == {"reference"}
        assert all(visit.setting.place.parked for visit in visits)


def test_steps_go_up_and_then_down_at_percentages_of_the_pulse_range() -> None:
    rig = rig_named("pquad_single")  # pulses from 1050 to 1950 us
    levels = [visit.setting.level_us for visit in visits_of(read_plan("steps").resolved(rig), rig)]
    up = [1140.0, 1230.0, 1320.0, 1410.0, 1500.0, 1590.0, 1680.0, 1770.0]
    assert levels == up + up[::-1]
    plan = read_plan("endurance").resolved(rig)
    hour_s = expected_duration_s(plan, rig, visits_of(plan, rig))
    assert hour_s == pytest.approx(3600.0, rel=0.05)
    ramp = [visit.setting.level_us for visit in visits_of(read_plan("ramp").resolved(rig), rig)]
    assert ramp == [1140.0, 1770.0] * 2


def test_a_ramp_records_every_sample_on_the_way(tmp_path: Path) -> None:
    plan = read_plan("ramp")
    swept(plan, tmp_path / "run")
    pulses_us = read_samples(tmp_path / "run").column("pwm1_us")
    between = np.unique(pulses_us[(pulses_us > 1140.0) & (pulses_us < 1770.0)])
    # 20 s in steps of 50 ms: 400 of 1.575 us, the last of them the end itself.
    assert len(between) >= 399
    assert np.max(np.diff(between)) <= 630.0 / 400.0 + 1e-6


def test_nothing_is_moved_on_a_bench_without_a_stage(tmp_path: Path) -> None:
    run = swept(SHORT, tmp_path / "run", stage="none")
    points = read_points(run.path)
    assert len(points) == 4
    assert np.isnan(points.column("plate_stage_z_m")).all()
    assert run.metadata["plate"]["stage"] == "none"
    text = (run.path / "events.jsonl").read_text()
    assert "no plate is moved: throttle alone is visited" in text
    with pytest.raises(InputError, match="--stage none moves no plate, but the plan visits"):
        swept(Plan(), tmp_path / "other", stage="none")
    assert not (tmp_path / "other").exists()


def test_ctrl_c_stops_and_the_test_goes_on_later(tmp_path: Path) -> None:
    given = SweepInputs(address="sim:pquad_single", plan=SHORT, out=tmp_path / "run", yes=True)
    with pytest.raises(RunStopped, match="zero was commanded"):
        sweep_to_run(given, Interrupted(), refuse_code)
    assert read_samples(tmp_path / "run").column("pwm1_us")[-1] <= 1000.0
    rest = SweepInputs(resume=tmp_path / "run", yes=True)
    sweep_to_run(rest, Unattended(), refuse_code)
    assert sorted(read_points(tmp_path / "run").column("point")) == [1, 2, 3, 4]


def test_wrong_plans_are_refused_in_one_sentence() -> None:
    rig = rig_named("pquad_single")
    with pytest.raises(UnknownChoice, match=r"unknown plan .* 'step'; did you mean 'steps'"):
        read_plan("step")
    both = "[throttle]\npwm_us = [1500.0]\npercent = [50.0]\n"
    with pytest.raises(FileFormatError, match=r"pwm_us and throttle\.percent are both given"):
        plan_from_toml(both, "plan.toml")
    nothing = plan_from_toml("[plate]\nused = false\n[order]\nreferences = false\n", "plan.toml")
    with pytest.raises(PlanError, match="both false, so nothing is visited"):
        check_plan(nothing.resolved(rig), rig)


@pytest.mark.parametrize(
    ("option", "key"),
    [
        ({"z_m": "0.3"}, r"plate.distances_m \(--z-m\)"),
        ({"z_over_r": (1.0,)}, r"plate.distances_over_R \(--z-over-r\)"),
        ({"tilt": 3.0}, r"plate.tilts_deg \(--tilt\)"),
    ],
)
def test_a_plan_without_a_plate_refuses_where_a_plate_shall_stand(
    option: dict[str, Any], key: str, tmp_path: Path
) -> None:
    with pytest.raises(PlanError, match=f"{key} is given, but the plan turns rotors without"):
        bt.sweep("sim:pquad_single", plan="steps", yes=True, out=tmp_path / "run", **option)
    assert not (tmp_path / "run").exists()


def test_a_test_without_a_plate_speaks_of_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = bt.sweep(
        "sim:pquad_single", plan="steps", yes=True, out=tmp_path / "run", throttle="30,60",
        sample_s=0.2, repeats=1,
    )  # fmt: skip
    printed = capsys.readouterr().out
    assert "1/2  14" in printed or "1/2  13" in printed, printed
    assert not [word for word in ("reference", "anchor", "z/R") if word in printed], printed
    blocks = [block for section in SWEEP.sections(run.found) for block in section.blocks]
    heads = {head for block in blocks if isinstance(block, Table) for head in block.header}
    assert "pulse [µs]" in heads
    assert not {"plate z/R", "T_IGE/T_OGE"} & heads
    assert not [block for block in blocks if "anchor" in getattr(block, "caption", "")]
