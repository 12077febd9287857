"""A lag that depends on speed and direction, against its own differential equation."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.rig_file import rig_named
from benchtool.physics.model import Model
from benchtool.simulate.hooks import joined_hooks, loop_effects, loop_numbers
from benchtool.simulate.motors import lagged, motion_of

TAU_S, DT_S, REFERENCE = 0.025, 0.002, 600.0
RIG = rig_named("beam")


def shaped(with_speed: float, rising: float) -> Model:
    model = Model.single(RIG).with_effect("motor_lag", tau_s=TAU_S)
    return model.with_effect(
        "lag_shape", with_speed=with_speed, rising=rising, middle_rad_s=REFERENCE
    )


def followed(model: Model, start: float, wanted: float, steps: int) -> float:
    """Return a rotor's speed after so many plant steps towards a command: rad/s."""
    effects, motion = loop_effects(model), motion_of(model, DT_S)
    hooks, p = joined_hooks(effects, 2, model.image_rules)(), loop_numbers(model, effects)
    speeds, both = (start, start), (wanted, wanted)
    for _ in range(steps):
        for half in (motion.first, motion.second):
            speeds = hooks.followed(speeds, lagged(half, speeds, both, both), p)
    return float(speeds[0])


@pytest.mark.parametrize("speed", [450.0, 600.0, 750.0])
@pytest.mark.parametrize("step", [-20.0, 20.0])
def test_a_rotor_follows_with_the_lag_of_its_speed(speed, step):
    model, e, a = shaped(0.3, 0.1), 0.3, 0.1
    reached = followed(model, speed, speed + step, 10)
    rate = (1.0 + e * (speed / REFERENCE - 1.0) - a * np.sign(step)) / TAU_S
    assert reached == pytest.approx(speed + step * (1.0 - np.exp(-rate * 10 * DT_S)), abs=0.15)
