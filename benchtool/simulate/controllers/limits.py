"""Command limits: amplitude, rate of change, anti-windup."""

from __future__ import annotations

import numpy as np

from benchtool.physics.expression import Quantity, expression


@expression
def clip(value: Quantity, limit: Quantity) -> Quantity:
    """Return the value within [-limit, limit]."""
    return np.minimum(np.maximum(value, -limit), limit)


@expression
def limit_slew_rate(
    requested: Quantity, present: Quantity, rate_limit: Quantity, dt_s: Quantity
) -> Quantity:
    """Return `requested`, limited in its rate of change to `rate_limit` per second."""
    return present + clip(requested - present, rate_limit * dt_s)


@expression
def integrate_clamped(
    integral: Quantity, change_per_s: Quantity, limit: Quantity, dt_s: Quantity
) -> Quantity:
    """Return an integral after one period, clipped to its limit."""
    return clip(integral + change_per_s * dt_s, limit)


@expression
def anti_windup_rate(requested: Quantity, granted: Quantity, change_per_s: Quantity) -> Quantity:
    """Return the rate of change of an integral, or 0 while it would increase a saturation.

    Anti-windup by clamping: `requested` is the command of the law, `granted` the same after the
    limit. A change that reduces the saturation is always allowed.
    """
    outward = (requested - granted) * change_per_s
    return change_per_s * (1.0 - np.minimum(np.maximum(np.sign(outward), 0.0), 1.0))
