"""Play in the plate's drive gets one sign."""

from __future__ import annotations

from dataclasses import replace
from typing import ClassVar

import numpy as np

from benchtool.bench.stage.stage import DeviceStage, OneSidedStage
from benchtool.core.rig import PlateDrive
from benchtool.core.rig_file import rig_named
from benchtool.physics.model_file import load_model
from benchtool.simulate.imperfections import Imperfections
from benchtool.virtual.simulated import SimulatedBench


class Listed:
    """A stage that lists where it was sent."""

    facts: ClassVar = {"stage": "listed"}
    measures_to_m = 0.0

    def __init__(self) -> None:
        self.sent: list[float] = []

    def open(self) -> None: ...

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: object) -> float:
        self.sent.append(round(z_m, 6))
        return z_m

    def hold(self) -> None: ...

    def close(self) -> None: ...


def plate(backlash_m: float) -> PlateDrive:
    return replace(rig_named("pquad").plate, backlash_m=backlash_m)


def pause(_seconds: float) -> None: ...


def test_it_overshoots_only_where_it_moves_away() -> None:
    inner = Listed()
    stage = OneSidedStage(inner, plate(0.001))
    for z_m in (0.2, 0.1, 0.3, 1.498):
        assert stage.move(z_m, 0.0, 0.0, pause) == z_m
    assert inner.sent == [0.205, 0.2, 0.1, 0.305, 0.3, 1.5, 1.498]
    stage.hold()  # stopped anywhere: the next move takes the play up again
    stage.move(0.2, 0.0, 0.0, pause)
    assert inner.sent[-2:] == [0.205, 0.2]


def test_without_play_every_move_is_one() -> None:
    inner = Listed()
    stage = OneSidedStage(inner, plate(0.0))
    for z_m in (0.2, 0.3):
        stage.move(z_m, 0.0, 0.0, pause)
    assert inner.sent == [0.2, 0.3]


def test_a_distance_reads_the_same_from_either_side() -> None:
    """On the virtual bench thrust depends on the way there, unless the way is one-sided."""
    rig = rig_named("pquad")
    quiet = replace(Imperfections.none(), backlash_m=0.001, thrust_rate_Hz=80.0)

    def thrusts(one_sided: bool) -> np.ndarray:
        bench = SimulatedBench(
            "sim:pquad", rig, load_model("quad_body_lift").model, imperfections=quiet
        )
        with bench:
            bench.open()
            stage = DeviceStage(bench)
            chosen = OneSidedStage(stage, plate(0.001)) if one_sided else stage
            read = []
            for before in (0.06, 0.3):
                for z_m in (before, 0.1):
                    chosen.move(z_m, 0.0, 0.0, pause)
                bench.set_pwm(np.full(4, 1500.0))
                bench.read(2.0)
                column = [channel.name for channel in bench.identity.channels].index("thrust_N")
                read.append(float(np.nanmean(bench.read(0.5).values[:, column])))
                bench.set_pwm(np.full(4, 1000.0))
                bench.read(3.0)
        return np.array(read)

    assert np.ptp(thrusts(one_sided=False)) > 0.03
    assert np.ptp(thrusts(one_sided=True)) < 1e-6
