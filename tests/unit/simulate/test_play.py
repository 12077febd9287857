"""A load cell with hysteresis on the virtual bench."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.rig_file import rig_named
from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model
from benchtool.simulate.imperfections import Imperfections
from benchtool.simulate.plate_bench import PlateBench
from benchtool.simulate.truth import Play

RIG = rig_named("pquad_single")


def test_a_play_takes_up_its_width_before_it_turns():
    play = Play(0.5)
    assert play.follow(np.array([1.0, 2.0])).tolist() == [1.0, 1.0]
    assert play.follow(np.array([1.75, 1.5, 1.0, 0.0])).tolist() == [0.5, 0.0, -1.0, -1.0]


def test_levels_visited_up_and_down_read_as_the_settled_model_says():
    truth = Model.single(RIG).with_effect("load_cell_hysteresis", half_width_N=0.05)
    bench = PlateBench(RIG, truth, np.random.default_rng(1), Imperfections.none())
    thrust = [channel.name for channel in bench.channels].index("thrust_N")
    bench.tare()
    for pwm_us, direction in ((1400.0, 1.0), (1500.0, 1.0), (1400.0, -1.0), (1000.0, -1.0)):
        bench.command_pwm(np.array([pwm_us]))
        bench.advance(400)
        shown = bench.advance(10)[-1, thrust]
        settled = Conditions.of(
            RIG,
            speed_rad_s=np.array([max(0.0, pwm_us - 1050.0) * 1.05]),
            plate_z_m=np.array([RIG.plate.z_park_m]),
            load_direction=direction,
        )
        assert shown == pytest.approx(truth.thrust_N(settled)[0], abs=1e-9)
    bench.tare()
    assert bench.advance(10)[-1, thrust] == pytest.approx(0.0, abs=1e-9)
