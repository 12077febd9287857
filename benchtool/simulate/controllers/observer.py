"""Disturbance observer of eq. (12), in momentum form: no acceleration has to be measured.

Eq. (12) as printed has no dynamics (its left side must be the estimate's time derivative) and
needs M qdd. With the momentum p = M qd in its place, for each of the six components,

    F_hat = L (p - z),    dz/dt = F_known + F_hat,

F_known being everything the model knows about: commanded force, gravity, Coriolis terms. Then
dF_hat/dt = L (F - F_hat): a first-order filter of the true disturbance. The paper's controller
uses the torque components.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from benchtool.core.array import Array
from benchtool.core.errors import InputError
from benchtool.physics.expression import Quantity, expression

COMPONENTS = ("force_x_N", "force_y_N", "force_z_N", "roll_Nm", "pitch_Nm", "yaw_Nm")
"""The six components of the estimate, as in eq. (12)."""


@expression
def observed(momentum: Quantity, explained: Quantity, rate_per_s: Quantity) -> Quantity:
    """Return the estimate L (p - z) of one component: N or N m."""
    return rate_per_s * (momentum - explained)


@expression
def next_explained(
    momentum: Quantity,
    explained: Quantity,
    known: Quantity,
    estimate: Quantity,
    on: Quantity,
    dt_s: Quantity,
) -> Quantity:
    """Return z one period on: what the known force and the estimate explain of the momentum.

    Args:
        momentum: p: N s or N m s.
        explained: z, the same.
        known: known force, with the compensation that was commanded in it: N or N m.
        estimate: from `observed`, with the same momentum: N or N m.
        on: 1 while the observer runs; 0 lets z follow p, so that it starts from zero without a
            bump.
        dt_s: control period: s.
    """
    return on * (explained + (known + estimate) * dt_s) + (1.0 - on) * momentum


@dataclass(slots=True)
class DisturbanceObserver:
    """Run the observer on six components outside of a compiled loop.

    Attributes:
        rates_per_s: L of each component (6,): 1/s; 0 leaves a component out.
        explained: z (6,).
    """

    rates_per_s: Array
    explained: Array = field(default_factory=lambda: np.zeros(6))

    def __post_init__(self) -> None:
        self.rates_per_s = np.asarray(self.rates_per_s, float)
        if self.rates_per_s.shape != (6,) or not np.all(self.rates_per_s >= 0.0):
            raise InputError(
                f"an observer needs six rates of 0 or more in 1/s, got {self.rates_per_s.tolist()}"
            )

    def restart(self, momentum: Array) -> None:
        """Begin anew with an estimate of zero at this momentum (6,)."""
        self.explained = np.asarray(momentum, float).copy()

    def step(self, momentum: Array, known: Array, dt_s: float) -> Array:
        """Return the estimate (6,) for this instant and go one period on.

        Args:
            momentum: linear (N s) and angular (N m s) momentum (6,).
            known: forces (N) and torques (N m) that the model knows about (6,).
            dt_s: control period: s.
        """
        estimate: Array = observed(momentum, self.explained, self.rates_per_s)
        self.explained = next_explained(
            momentum, self.explained, np.asarray(known, float), estimate, 1.0, dt_s
        )
        return estimate
