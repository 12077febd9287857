"""Feedforward: divide each rotor's commanded thrust by the factor that the model expects there."""

from __future__ import annotations

import numpy as np

from benchtool.physics.expression import Quantity, expression


@expression
def expected_factor(factor: Quantity, strength: Quantity) -> Quantity:
    """Return the factor to divide by: 1 + strength (f - 1); strength 0 is no feedforward.

    A strength below 1 stands for a model that knows only part of the effect.
    """
    return 1.0 + strength * (factor - 1.0)


@expression
def compensated_thrust(thrust_N: Quantity, factor: Quantity) -> Quantity:
    """Return the thrust to ask for out of ground effect, so that f times it is what is wanted: N.

    A rotor cannot pull: negative thrusts are cut at 0.
    """
    return np.maximum(thrust_N, 0.0) / factor
