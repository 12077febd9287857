"""A plate that a stage beside the bench moves: the stage's word against the bench's reading."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import pytest

from benchtool.acquire.inputs import SweepInputs
from benchtool.acquire.plan import plan_from_toml
from benchtool.acquire.resume import load_resume_state
from benchtool.acquire.sweep import Sweep
from benchtool.bench.guard import GuardedBench
from benchtool.bench.stage.stage import PlateStage
from benchtool.core.errors import BenchtoolError, StageError
from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.run.append import read_events
from benchtool.data.run.read import read_points
from benchtool.data.run.run import Run
from benchtool.physics.model_file import load_model
from benchtool.virtual.devices import build_hello, virtual_plant
from benchtool.virtual.simulated_bench import SimulatedBench
from tests.unit.acquire.fake_bench import FakeBench

RIG = load_rig_by_name("pquad_single")
STAGE = "grbl:/dev/ttyS9?axis=Z&zero_mm=1500&direction=1"


def bench_beside(seed: int = 0) -> SimulatedBench:
    """Return a virtual bench whose plate something else moves."""
    truth = load_model("single", RIG).model
    plant = virtual_plant(RIG, truth, seed)
    hello = replace(build_hello(plant, truth, seed), moves_plate=False)
    return SimulatedBench("sim:pquad_single", plant, hello)


class Carries(PlateStage):
    """Be a stage that carries the plate of a virtual bench, and may lose steps on its way.

    Args:
        bench: whose plate.
        lost_m: at the n-th move the plate falls so far behind, towards the rotor where negative.
    """

    facts: ClassVar = {"stage": STAGE}

    def __init__(self, bench: SimulatedBench, lost_m: dict[int, float] | None = None) -> None:
        super().__init__()
        self._bench, self._lost_m = bench, lost_m or {}
        self._off_m = 0.0
        self.moves = 0
        self.highest_us = 0.0

    def _move_once(self, z_m, x_m, tilt_rad, pause):
        self._off_m += self._lost_m.get(self.moves, 0.0)
        self.moves += 1
        self._bench._firmware._plant.command_plate(z_m + self._off_m, 0.0, 0.0)
        while self._bench._plant.plate_moving:
            self._bench._advance(0.1)
        return z_m


def sweep(bench: SimulatedBench, stage: Carries, distances: str, path: Path) -> list[float]:
    """Sweep distances; return the distance of every point that was measured."""
    plan = plan_from_toml(
        f"""
repeats = 1
sample_s = 0.5
[plate]
distances_m = [{distances}]
[throttle]
pwm_us = [1500.0]
[order]
kind = "as_given"
references = false
anchor_every = 0
""",
        "plan",
    ).resolved(RIG)
    with GuardedBench(bench, RIG) as guarded:
        measured = Sweep(SweepInputs(plan=plan, out=path), RIG)
        stage._guard = guarded
        measured.stage = stage
        try:
            measured.record(guarded, measured.create_run(guarded.identity))
        finally:
            stage.highest_us = float(guarded.pwm_us.max())
    return read_points(path).column("plate_z_m").tolist()


def test_a_stage_that_is_right_is_believed_and_remembered(tmp_path):
    bench = bench_beside()
    found = sweep(bench, Carries(bench), "0.1, 0.5", tmp_path / "run")
    assert found == pytest.approx([0.1, 0.5], abs=2e-4)
    assert Run.open(tmp_path / "run").metadata["plate"]["stage"] == STAGE


@pytest.mark.parametrize(
    ("lost_m", "distances", "said"),
    [
        # 40 mm nearer than the stage says: 29 mm, where the rig's least gap is 50 mm.
        ({2: -0.041}, "0.2, 0.6, 0.07", "reads 0.0290 m .*, inside the minimum gap of 0.05 m"),
        ({1: 0.04}, "0.2, 0.6", "reads 0.6400 m after the move to 0.6 m, tolerance 1.5 mm"),
        ({0: -0.03}, "0.2", "reads 0.1700 m after the move to 0.2 m"),
        ({0: 1.2}, "0.2", "still reads 1.4000 m after the move to 0.2 m"),
    ],
)
def test_lost_steps_end_the_run_before_motors_turn(tmp_path, lost_m, distances, said):
    bench = bench_beside()
    stage = Carries(bench, lost_m)
    with pytest.raises(StageError, match=said):
        sweep(bench, stage, distances, tmp_path / "run")
    assert stage.highest_us == 1000.0
    # The points before it stand; the one that was not seen is not there.
    events = [event.event for event in read_events(tmp_path / "run" / "events.jsonl")]
    assert events[-1] == "stopped"


class Miswired(Carries):
    """The plate goes elsewhere than it was sent, and the stage says so."""

    def _move_once(self, z_m, x_m, tilt_rad, pause):
        return super()._move_once(z_m + 0.2, x_m, tilt_rad, pause)


def test_a_stage_that_reports_another_place_than_its_target_ends_the_run(tmp_path):
    bench = bench_beside()
    stage = Miswired(bench)
    said = r"reads 1\.3000 m after the move to 1\.1 m, .* reports 1\.3000 m, tolerance 1\.5 mm"
    with pytest.raises(StageError, match=said):
        sweep(bench, stage, "1.1", tmp_path / "run")
    assert stage.highest_us == 1000.0


def test_it_does_so_without_a_position_channel():
    with GuardedBench(FakeBench(), RIG) as bench:
        bench.confirm_plate(1.1, 1.1014)
        with pytest.raises(StageError, match=r"stage reports 1\.1016 m after the move to 1\.1 m"):
            bench.confirm_plate(1.1, 1.1016)


def test_a_resumed_run_names_the_stage_that_moved_the_plate(tmp_path):
    bench = bench_beside()
    with pytest.raises(BenchtoolError):
        sweep(bench, Carries(bench, {1: 0.04}), "0.2, 0.6", tmp_path / "run")
    run = Run.open(tmp_path / "run")
    run.close()
    assert load_resume_state(run).stage == STAGE
