"""Ground effect of several discs over a plate, by a momentum balance with an exponent of its own.

Each disc's image blows upward; the sum of that, D, lowers the induced velocity v. A rotor held at
power T v with v going as T^(1/2) answers with (1 - D)^(-2/3); held at T v = const with v unchanged
by thrust, with 1 / (1 - D). A propeller at given speed lies somewhere about: (1 - D/p)^(-p), with p
drawn for every bench. Its increment is up to about 3 % off Cheeseman and Bennett's in shape.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(32)


@dataclass(frozen=True, slots=True, kw_only=True)
class GroundLaw:
    """Hold the numbers of a bench's ground effect.

    Attributes:
        near: relative change of the own image close to the plate, falling off as exp(-z/R).
    """

    radius_m: float  # effective rotor radius
    softness: float = 1.0  # 1/p of the exponent
    near: float = 0.0
    neighbours: float = 1.0  # strength of the neighbours' images
    K_b: float = 0.0  # strength of the upwash at the body's centre

    def factor(self, height_m: Array, covered: Array, x_m: Array, y_m: Array) -> Array:
        """Return T over its value without a plate, for a disc wholly over it (n, m).

        Args:
            height_m: of each disc over the plate (n, m).
            covered: fraction of each disc over the plate (n, m); the source of its image.
            x_m, y_m: axes (n,).
        """
        n = len(x_m)
        own = _upwash(height_m, 0.0) * (1.0 + self.near * np.exp(-height_m / self.radius_m))
        others = np.zeros_like(height_m)
        for i in range(n):
            for j in range(n):
                if j != i:
                    apart = float(np.hypot(x_m[i] - x_m[j], y_m[i] - y_m[j]))
                    others[i] += covered[j] * _upwash(height_m[i], apart)
        centre = np.zeros_like(height_m)
        if n > 1:
            # Nobody has measured how partly covered rotors share it: from the second one on.
            shared = np.maximum(0.0, (covered.sum(axis=0) - 1.0) / (n - 1.0))
            for j in range(n):
                centre += shared * _upwash(height_m, float(np.hypot(x_m[j], y_m[j])))
        total = self.radius_m**2 * (own + self.neighbours * others + self.K_b * centre)
        if self.softness == 0.0:
            return np.asarray(np.exp(total))
        inside = np.maximum(1.0 - self.softness * total, 0.05)
        out: Array = inside ** (-1.0 / self.softness)
        return out


def _upwash(height_m: Array, apart_m: float) -> Array:
    """Return the velocity of a mirrored source at a disc, per R^2 and induced velocity: 1/m2."""
    slant_m = np.sqrt(apart_m**2 + (2.0 * height_m) ** 2)
    out: Array = 0.25 * (2.0 * height_m) / slant_m**3
    return out


def covered_fraction(x_m: Array, radius_m: float, from_m: Array, to_m: Array) -> Array:
    """Return the fraction of discs at x (n, 1) over a plate from..to (m,): (n, m).

    Chord by chord; the plate is wider than any disc across.
    """
    low = np.clip((from_m - x_m) / radius_m, -1.0, 1.0)
    high = np.clip((to_m - x_m) / radius_m, -1.0, 1.0)
    # t = sin(u) takes the roots at the rim away.
    a, b = np.arcsin(low), np.arcsin(np.maximum(high, low))
    u = 0.5 * (a + b)[..., None] + 0.5 * (b - a)[..., None] * _NODES
    area = np.sum(_WEIGHTS * 2.0 * np.cos(u) ** 2, axis=-1) * 0.5 * (b - a)
    out: Array = area / np.pi
    return out


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
