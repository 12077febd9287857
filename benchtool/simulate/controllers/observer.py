"""Disturbance observer of eq. (12), in momentum form: no acceleration has to be measured.

Eq. (12) as printed has no dynamics (its left side must be the estimate's time derivative) and
needs M qdd. With the momentum p = M qd in its place, for each of the six components,

    F_hat = L (p - z),    dz/dt = F_known + F_hat,

where F_known is the sum of all modelled forces: commanded force, gravity, Coriolis terms. Then
dF_hat/dt = L (F - F_hat): a first-order filter of the true disturbance. The paper's controller
uses the torque components.
"""

from __future__ import annotations

from benchtool.physics.expression import Quantity, expression


@expression
def estimate_disturbance(
    momentum: Quantity, explained_momentum: Quantity, rate_per_s: Quantity
) -> Quantity:
    """Return the estimate L (p - z) of one component: N or N m."""
    return rate_per_s * (momentum - explained_momentum)


@expression
def next_explained_momentum(
    momentum: Quantity,
    explained_momentum: Quantity,
    modelled_force: Quantity,
    estimate: Quantity,
    enabled: Quantity,
    dt_s: Quantity,
) -> Quantity:
    """Return z after one period: the momentum explained by modelled force and estimate.

    Args:
        modelled_force: includes the commanded compensation: N or N m.
        estimate: from `estimate_disturbance`, with the same momentum: N or N m.
        enabled: 1 while the observer runs; 0 sets z = p, so that the estimate starts from zero.
    """
    return (
        enabled * (explained_momentum + (modelled_force + estimate) * dt_s)
        + (1.0 - enabled) * momentum
    )
