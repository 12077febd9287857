"""Thrust of a rotor out of ground effect: blade elements in a momentum inflow, annulus by annulus.

A two-bladed 9.4 x 4.5 inch propeller: constant chord, constant pitch, lift slope that changes with
the Reynolds number as a power. The inflow of an annulus has a closed form (Gessow 1948; Leishman
2006, eq. 3.61). Only ratios are used: the size is that of the bench.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BLADES = 2
RADIUS_M = 0.12
CHORD_M = 0.018
PITCH_M = 4.5 * 0.0254
LIFT_SLOPE = 5.5
REFERENCE_RAD_S = 500.0

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_R = 0.15 + 0.85 * 0.5 * (_NODES + 1.0)
_W = 0.5 * 0.85 * _WEIGHTS
_THETA = np.arctan(PITCH_M / (2.0 * np.pi * RADIUS_M * _R))
_SOLIDITY = BLADES * CHORD_M / (np.pi * RADIUS_M)


def coefficient(speed_rad_s: Array, reynolds_power: float) -> Array:
    """Return thrust over squared speed, over its value at the reference speed (...)."""
    speed = np.maximum(np.asarray(speed_rad_s, float), 1.0)
    slope = LIFT_SLOPE * (speed / REFERENCE_RAD_S) ** reynolds_power
    here: Array = _lift(slope) / _lift(np.array(LIFT_SLOPE))
    return here


def reynolds_power(excess: float) -> float:
    """Return the power of the lift slope for which thrust goes as speed^(2 + excess)."""
    step = 1e-4
    up, down = (
        _lift(np.array(LIFT_SLOPE * (1.0 + step))),
        _lift(np.array(LIFT_SLOPE * (1.0 - step))),
    )
    sensitivity = float(np.log(up / down) / np.log((1.0 + step) / (1.0 - step)))
    return excess / sensitivity


def _lift(slope: Array) -> Array:
    """Return the integral of lift over the blade for lift slopes (...), in units of its own."""
    loading = (_SOLIDITY * slope / 16.0)[..., None]
    inflow = loading * (np.sqrt(1.0 + 2.0 * _THETA * _R / loading) - 1.0)
    lift: Array = slope * np.sum(_W * (_THETA - inflow / _R) * _R**2, axis=-1)
    return lift
