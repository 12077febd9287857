"""The moving case of the same hooks: rotor speeds followed in time with the commands held.

A plain reference that the settled predictions of `Model` are checked against.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model

Array = NDArray[np.float64]


def moving_thrust_N(model: Model, conditions: Conditions, duration_s: float, steps: int) -> Array:
    """Return the load cell's reading (m,) after the commands were held for `duration_s`: N.

    Rotors start at rest and follow with the model's lag, by the classical fourth-order Runge-Kutta
    rule.
    """
    values = model.parameters.values_array()
    flow = model.flow(conditions, values)
    if model.lag_s > 0.0 and not conditions.speed_measured:
        speeds = [_follow(model.lag_s, drive, duration_s, steps) for drive in flow.speed_rad_s]
        flow = flow._replace(speed_rad_s=speeds)
    out: Array = np.asarray(model.reading_N(flow, values), float)
    return out


def _follow(lag_s: float, drive: Array, duration_s: float, steps: int) -> Array:
    dt = duration_s / steps
    x = np.zeros_like(drive)
    for _ in range(steps):
        k1 = (drive - x) / lag_s
        k2 = (drive - x - 0.5 * dt * k1) / lag_s
        k3 = (drive - x - 0.5 * dt * k2) / lag_s
        k4 = (drive - x - dt * k3) / lag_s
        x = x + dt / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return x
