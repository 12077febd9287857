"""Limits on commands: amplitude, rate of change, and integrals that stop at theirs."""

from __future__ import annotations

import numpy as np

from benchtool.physics.expression import Quantity, expression


@expression
def limited(value: Quantity, limit: Quantity) -> Quantity:
    """Return the value within [-limit, limit]."""
    return np.minimum(np.maximum(value, -limit), limit)


@expression
def slewed(wanted: Quantity, present: Quantity, rate_limit: Quantity, dt_s: Quantity) -> Quantity:
    """Return the next value on the way to `wanted`, no faster than `rate_limit` per second."""
    return present + limited(wanted - present, rate_limit * dt_s)


@expression
def integrated(
    integral: Quantity, change_per_s: Quantity, limit: Quantity, dt_s: Quantity
) -> Quantity:
    """Return an integral one period on, held at its limit."""
    return limited(integral + change_per_s * dt_s, limit)


@expression
def unwound(wanted: Quantity, granted: Quantity, change_per_s: Quantity) -> Quantity:
    """Return the integral's rate of change, or 0 while it drives an actuator that is at its limit.

    Anti-windup by clamping: `wanted` is what the law asked for, `granted` what the limit let
    through; the integral stops while the change would push further out, and may always come back.
    """
    outward = (wanted - granted) * change_per_s
    return change_per_s * (1.0 - np.minimum(np.maximum(np.sign(outward), 0.0), 1.0))
