"""Disturbance observer of eq. (12), in momentum form: no acceleration has to be measured.

Eq. (12) as printed has no dynamics (its left side must be the estimate's time derivative) and
needs M qdd. With the momentum p = M qd in its place, for each of the six components,

    F_hat = L (p - z),    dz/dt = F_known + F_hat,

F_known being everything the model knows about: commanded force, gravity, Coriolis terms. Then
dF_hat/dt = L (F - F_hat): a first-order filter of the true disturbance. The paper's controller
uses the torque components.
"""

from __future__ import annotations

from benchtool.physics.expression import Quantity, expression


@expression
def update_observer(momentum: Quantity, explained: Quantity, rate_per_s: Quantity) -> Quantity:
    """Return the estimate L (p - z) of one component: N or N m."""
    return rate_per_s * (momentum - explained)


@expression
def next_disturbance_estimate(
    momentum: Quantity,
    explained: Quantity,
    known: Quantity,
    estimate: Quantity,
    on: Quantity,
    dt_s: Quantity,
) -> Quantity:
    """Return z one period on: what the known force and the estimate explain of the momentum.

    Args:
        known: known force, with the compensation that was commanded in it: N or N m.
        estimate: from `update_observer`, with the same momentum: N or N m.
        on: 1 while the observer runs; 0 lets z follow p, so that it starts from zero without a
            bump.
    """
    return on * (explained + (known + estimate) * dt_s) + (1.0 - on) * momentum
