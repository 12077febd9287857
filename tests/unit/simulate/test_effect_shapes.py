"""Shapes of lag, play and friction against their differential equations."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model
from benchtool.simulate.controllers.controller import GRAVITY_M_S2
from benchtool.simulate.hooks import (
    build_motion,
    first_order_lag,
    joined_hooks,
    loop_effects,
    loop_numbers,
)
from benchtool.simulate.imperfections import BacklashState, Imperfections
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.filter_log import LoggedPitch, predict_windows
from benchtool.simulate.plate_bench import PlateBench

TAU_S, DT_S, REFERENCE = 0.025, 0.002, 600.0
RIG = load_rig_by_name("beam")


def shaped(with_speed: float, rising: float) -> Model:
    model = Model.single(RIG).with_effect("motor_lag", tau_s=TAU_S)
    return model.with_effect(
        "lag_shape", with_speed=with_speed, rising=rising, middle_rad_s=REFERENCE
    )


def followed(model: Model, start: float, wanted: float, steps: int) -> float:
    """Return a rotor's speed after so many plant steps towards a command: rad/s."""
    effects, motion = loop_effects(model), build_motion(model, DT_S)
    hooks, p = joined_hooks(effects, 2, model.image_rules)(), loop_numbers(model, effects)
    speeds, both = (start, start), (wanted, wanted)
    for _ in range(steps):
        for half in (motion.first, motion.second):
            speeds = hooks.followed(speeds, first_order_lag(half, speeds, both, both), p)
    return float(speeds[0])


@pytest.mark.parametrize("speed", [450.0, 600.0, 750.0])
@pytest.mark.parametrize("step", [-20.0, 20.0])
def test_a_rotor_follows_with_the_lag_of_its_speed(speed, step):
    model, e, a = shaped(0.3, 0.1), 0.3, 0.1
    reached = followed(model, speed, speed + step, 10)
    rate = (1.0 + e * (speed / REFERENCE - 1.0) - a * np.sign(step)) / TAU_S
    assert reached == pytest.approx(speed + step * (1.0 - np.exp(-rate * 10 * DT_S)), abs=0.15)


RIG_PLAY = load_rig_by_name("pquad_single")


def test_a_play_takes_up_its_width_before_it_turns():
    play = BacklashState(0.5)
    assert play.follow(np.array([1.0, 2.0])).tolist() == [1.0, 1.0]
    assert play.follow(np.array([1.75, 1.5, 1.0, 0.0])).tolist() == [0.5, 0.0, -1.0, -1.0]


def test_levels_visited_up_and_down_read_as_the_settled_model_says():
    truth = Model.single(RIG_PLAY).with_effect("load_cell_hysteresis", half_width_N=0.05)
    bench = PlateBench(RIG_PLAY, truth, np.random.default_rng(1), Imperfections.none())
    thrust = [channel.name for channel in bench.channels].index("thrust_N")
    bench.tare()
    for pwm_us, direction in ((1400.0, 1.0), (1500.0, 1.0), (1400.0, -1.0), (1000.0, -1.0)):
        bench.command_pwm(np.array([pwm_us]))
        bench.advance(400)
        shown = bench.advance(10)[-1, thrust]
        settled = Conditions.build(
            RIG_PLAY,
            speed_rad_s=np.array([max(0.0, pwm_us - 1050.0) * 1.05]),
            plate_z_m=np.array([RIG_PLAY.plate.z_park_m]),
            load_direction=direction,
        )
        assert shown == pytest.approx(truth.thrust_N(settled)[0], abs=1e-9)
    bench.tare()
    assert bench.advance(10)[-1, thrust] == pytest.approx(0.0, abs=1e-9)


RIG, ROWS = load_rig_by_name("beam"), 1500
HOLDS_NM, GIVE_RAD = 0.02, 0.01


def settled_rad(load: float, give_rad: float) -> float:
    """Return where a beam with rotors at rest ends under a share of what its hinge holds: rad."""
    offset_m = load * HOLDS_NM / (RIG.body.mass_kg * GRAVITY_M_S2)
    model = Model.single(RIG).with_effect("coulomb_friction", torque_Nm=HOLDS_NM, give_rad=give_rad)
    model = model.with_effect("cog_offset", x_m=offset_m).with_effect(
        "viscous_friction", damping_Nms=0.2
    )
    bench = PitchBench.from_model(model, sensors={}, plant_rate_Hz=500.0)
    row, rotors = np.zeros(ROWS), np.zeros((RIG.n_discs, ROWS))
    logged = LoggedPitch(
        rate_Hz=250.0, pwm_us=rotors + RIG.propulsion.pwm_start_us, plate_z_m=row + 1.0,
        plate_share=row, theta_rad=row, gyro_rad_s=row, speed_rad_s=rotors, mode=row,
    )  # fmt: skip
    state = np.zeros((4 + RIG.n_discs, 1))
    return float(predict_windows([bench], logged, {0: state}, ROWS, 0)[0].theta_rad[-1, 0])


@pytest.mark.parametrize("load", [0.25, -0.5])
def test_it_yields_like_a_spring_below_its_torque(load):
    assert settled_rad(load, GIVE_RAD) == pytest.approx(load * GIVE_RAD, rel=0.02)


def test_without_it_the_hinge_sticks():
    assert settled_rad(0.5, 0.0) == 0.0


def test_beyond_its_torque_it_slips():
    assert settled_rad(1.5, GIVE_RAD) > 10.0 * GIVE_RAD
