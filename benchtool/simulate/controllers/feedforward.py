"""Feedforward: commanded thrust of each rotor divided by the factor of the model."""

from __future__ import annotations

import numpy as np

from benchtool.physics.expression import Quantity, expression


@expression
def expected_factor(factor: Quantity, strength: Quantity) -> Quantity:
    """Return the factor to divide by: 1 + strength (f - 1); strength 0 is no feedforward.

    A strength below 1 represents a model that predicts only part of the effect.
    """
    return 1.0 + strength * (factor - 1.0)


@expression
def compensated_thrust(thrust_N: Quantity, factor: Quantity) -> Quantity:
    """Return the OGE thrust to command for a requested thrust in ground effect: N.

    Rotors cannot produce negative thrust, so it is clipped to 0.
    """
    return np.maximum(thrust_N, 0.0) / factor
