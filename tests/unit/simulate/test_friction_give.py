"""A hinge that yields before it slips: a spring as far as it holds, Coulomb's law beyond."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.rig_file import rig_named
from benchtool.physics.model import Model
from benchtool.simulate.pitch.bench import GRAVITY_M_S2, PitchBench
from benchtool.simulate.pitch.filter_log import LoggedPitch, predict_windows

RIG, ROWS = rig_named("beam"), 1500
HOLDS_NM, GIVE_RAD = 0.02, 0.01


def settled_rad(load: float, give_rad: float) -> float:
    """Return where a beam with rotors at rest ends under a share of what its hinge holds: rad."""
    offset_m = load * HOLDS_NM / (RIG.body.mass_kg * GRAVITY_M_S2)
    model = Model.single(RIG).with_effect("coulomb_friction", torque_Nm=HOLDS_NM, give_rad=give_rad)
    model = model.with_effect("cog_offset", x_m=offset_m).with_effect(
        "viscous_friction", damping_Nms=0.2
    )
    bench = PitchBench.of(model, sensors={}, plant_rate_Hz=500.0)
    row, rotors = np.zeros(ROWS), np.zeros((RIG.n_discs, ROWS))
    logged = LoggedPitch(
        rate_Hz=250.0, pwm_us=rotors + RIG.propulsion.pwm_start_us, plate_z_m=row + 1.0,
        plate_share=row, theta_rad=row, gyro_rad_s=row, speed_rad_s=rotors, mode=row,
    )  # fmt: skip
    state = np.zeros((4 + RIG.n_discs, 1))
    return float(predict_windows([bench], logged, [0], ROWS, 0, [state])[0].theta_rad[-1, 0])


@pytest.mark.parametrize("load", [0.25, -0.5])
def test_it_yields_like_a_spring_below_its_torque(load):
    assert settled_rad(load, GIVE_RAD) == pytest.approx(load * GIVE_RAD, rel=0.02)


def test_without_it_the_hinge_sticks():
    assert settled_rad(0.5, 0.0) == 0.0


def test_beyond_its_torque_it_slips():
    assert settled_rad(1.5, GIVE_RAD) > 10.0 * GIVE_RAD
