"""The moving case of the same hooks: own states followed in time with the commands held.

A plain reference that the settled predictions of `Model` are checked against.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.effect import OwnState
from benchtool.physics.model import Model

Array = NDArray[np.float64]


def moving_thrust_N(model: Model, conditions: Conditions, duration_s: float, steps: int) -> Array:
    """Return the load cell's reading (m,) after the commands were held for `duration_s`: N.

    Every state starts at zero, as after a tare with the motors still, and is followed with the
    classical fourth-order Runge-Kutta rule.
    """
    values = model.parameters.values_array()
    commanded = model.flow(conditions, values)
    speeds = [np.asarray(speed, float) for speed in commanded.speed_rad_s]
    readings: dict[str, list[Any]] = {}
    for effect in model.present_effects:
        p = model.effect_values(effect, values)
        readings[effect.name] = []
        for state in effect.states:
            if state.drive == "speed_rad_s" and not conditions.speed_measured:
                speeds = [_follow(state, drive, p, duration_s, steps) for drive in speeds]
            elif state.drive == "none":
                still = np.zeros(len(conditions))
                readings[effect.name].append(_follow(state, still, p, duration_s, steps))
    flow = commanded._replace(speed_rad_s=speeds)
    reading = values[list(model.parameters).index("k")] * model.squared_speed(flow, values)
    for effect in model.present_effects:
        if effect.thrust_reading is not None:
            p = model.effect_values(effect, values)
            reading = effect.thrust_reading(reading, flow, readings[effect.name], p)
    out: Array = np.asarray(reading, float)
    return out


def _follow(state: OwnState, drive: Array, p: list[Any], duration_s: float, steps: int) -> Array:
    dt = duration_s / steps
    x = np.zeros_like(drive)
    for _ in range(steps):
        k1 = state.rate(x, drive, p)
        k2 = state.rate(x + 0.5 * dt * k1, drive, p)
        k3 = state.rate(x + 0.5 * dt * k2, drive, p)
        k4 = state.rate(x + dt * k3, drive, p)
        x = x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return x
