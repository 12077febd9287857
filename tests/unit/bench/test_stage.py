"""Play in the plate's drive gets one sign."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchtool.bench.guard import GuardedBench
from benchtool.bench.stage.stage import HandStage, PlateStage
from benchtool.core.errors import StageError
from benchtool.core.rig import PlateDrive
from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.model_file import load_model
from benchtool.virtual.devices import build_hello, virtual_plant
from benchtool.virtual.simulated_bench import SimulatedBench


class Listed(PlateStage):
    """A stage that lists where it was sent."""

    def __init__(self, *given) -> None:
        super().__init__(*given)
        self.sent: list[float] = []

    def _move_once(self, z_m, x_m, tilt_rad, pause):
        self.sent.append(round(z_m, 6))
        return z_m


def plate(backlash_m: float) -> PlateDrive:
    return replace(load_rig_by_name("pquad").plate, backlash_m=backlash_m)


def pause(_seconds: float) -> None: ...


def test_it_overshoots_only_where_it_moves_away():
    stage = Listed(plate(0.001))
    for z_m in (0.2, 0.1, 0.3, 1.498):
        assert stage.move(z_m, 0.0, 0.0, pause) == z_m
    assert stage.sent == [0.205, 0.2, 0.1, 0.305, 0.3, 1.5, 1.498]
    stage.hold()  # stopped anywhere: the next move takes the play up again
    stage.move(0.2, 0.0, 0.0, pause)
    assert stage.sent[-2:] == [0.205, 0.2]


def test_it_stays_above_idle_and_inside_the_gap():
    rig = load_rig_by_name("pquad")
    truth = load_model("quad_body_lift").model
    plant = virtual_plant(rig, truth, 0)
    bare = SimulatedBench("sim:pquad", plant, build_hello(plant, truth, 0))
    with GuardedBench(bare, rig) as bench:
        stage = Listed(None, bench)
        bare.move_plate(0.3)
        assert stage.move(0.3, 0.0, 0.0, pause) == 0.3
        with pytest.raises(StageError, match=r"outside 0\.05 to 1\.5 m"):
            stage.move(0.04, 0.0, 0.0, pause)
        with pytest.raises(StageError, match=r"sideways to 1 m, limit 0\.945 m"):
            stage.move(0.3, 1.0, 0.0, pause)
        bench.set_pwm(np.full(4, 1500.0))
        with pytest.raises(StageError, match="above idle"):
            stage.move(0.3, 0.0, 0.0, pause)
    assert stage.sent == [0.3]


PLATE = load_rig_by_name("pquad_single").plate


def stage(*answers):
    asked = []
    left = list(answers)

    def ask(question):
        asked.append(question)
        return left.pop(0)

    return HandStage(ask, PLATE), asked


def move(hand, z_m=0.24, x_m=0.0, tilt_rad=0.0):
    return hand.move(z_m, x_m, tilt_rad, lambda duration_s: None)


@pytest.mark.parametrize("answer", ["241.5", " 241.5 mm", "241,5"])
def test_the_measured_distance_is_what_counts(answer):
    hand, asked = stage(answer)
    assert move(hand) == pytest.approx(0.2415)
    assert asked == ["Move the plate to 240.0 mm, then type the distance that you measure in mm: "]
