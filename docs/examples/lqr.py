"""Control law: linear quadratic regulator of the pitch angle with integral state."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import solve_continuous_are

from benchtool.physics.expression import expression
from benchtool.simulate.controllers.blocks import clip, integrate_clamped
from benchtool.simulate.controllers.controller import ControlLaw, PitchCommand, PitchPlant

WEIGHTS = (40.0, 30.0, 1.0)  # of integral, error and rate, relative to 1 for (rad/s2)^2; assumed
MAX_INTEGRAL_RAD_S = 0.2  # assumed


class LqrNumbers(NamedTuple):
    """Plant and gains."""

    inertia_kgm2: Any
    torque_limit_Nm: Any
    integral_gain: Any
    error_gain: Any
    rate_gain: Any


class LqrState(NamedTuple):
    """Integral of the error."""

    integral_rad_s: Any = 0.0


@expression
def step(
    p: LqrNumbers, state: LqrState, measurement: Any, reference: Any, dt_s: Any
) -> tuple[LqrState, PitchCommand]:
    """Return the next state and the command."""
    error = reference.theta_rad - measurement.theta_rad
    acceleration = p.integral_gain * state.integral_rad_s + p.error_gain * error
    torque = p.inertia_kgm2 * (acceleration - p.rate_gain * measurement.rate_rad_s)
    integral = integrate_clamped(state.integral_rad_s, error, MAX_INTEGRAL_RAD_S, dt_s)
    return LqrState(integral), PitchCommand(clip(torque, p.torque_limit_Nm), 0.0)


def numbers(control: Any, plant: PitchPlant) -> LqrNumbers:
    """Return the plant and the gains of a double integrator with `WEIGHTS`."""
    a, b = np.diag([1.0, 1.0], 1), np.array([[0.0], [0.0], [1.0]])
    cost = solve_continuous_are(a, b, np.diag(WEIGHTS) * 10.0, np.eye(1))
    return LqrNumbers(*plant, *(float(gain) for gain in cost[2]))


LAW = ControlLaw(
    name="lqr", title="LQR with an integral state", step=step, state=LqrState(), numbers=numbers
)
