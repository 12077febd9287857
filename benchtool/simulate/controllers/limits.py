"""Limits on commands: amplitude, rate of change, and integrals that stop at theirs."""

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
    """Return the next value on the way to `requested`, no faster than `rate_limit` per second."""
    return present + clip(requested - present, rate_limit * dt_s)


@expression
def integrate_clamped(
    integral: Quantity, change_per_s: Quantity, limit: Quantity, dt_s: Quantity
) -> Quantity:
    """Return an integral one period on, held at its limit."""
    return clip(integral + change_per_s * dt_s, limit)


@expression
def unwrap_integral(requested: Quantity, granted: Quantity, change_per_s: Quantity) -> Quantity:
    """Return the integral's rate of change, or 0 while it drives an actuator that is at its limit.

    Anti-windup by clamping: `requested` is what the law asked for, `granted` what the limit let
    through; the integral stops while the change would push further out, and may always come back.
    """
    outward = (requested - granted) * change_per_s
    return change_per_s * (1.0 - np.minimum(np.maximum(np.sign(outward), 0.0), 1.0))
