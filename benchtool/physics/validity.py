"""Where the image formulae hold, what a simulator does below, and where they blow up."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchtool.physics.body_lift import BodyDistance
from benchtool.physics.expression import Quantity, expression
from benchtool.physics.multirotor import denominator_sums

VALIDITY_Z_OVER_R = 0.5
"""Least z/R at which the formulae are trusted: twice the pole of eq. (2); a convention of ours."""


@expression
def clamped_height(z_m: Quantity, radius_m: Quantity) -> Quantity:
    """Return the height, or the validity limit where it is lower: m.

    For simulators only, which report `count_clamped` beside it. A fit never clamps: it leaves
    such points out by default and says how many they are.
    """
    return np.maximum(z_m, 0.5 * radius_m)


def count_clamped(z_m: Quantity, radius_m: float) -> int:
    """Return how many heights lie below the validity limit, so that a clamp can be reported."""
    return int(np.count_nonzero(np.asarray(z_m) < VALIDITY_Z_OVER_R * radius_m))


def pole_z_over_R(
    radius_m: float,
    positions_m: NDArray[np.float64],
    K_b: float = 0.0,
    body_distance: BodyDistance = "half_diagonal",
) -> float:
    """Return the largest z/R at which some rotor's denominator vanishes, all discs covered.

    No image contributes more than (R/4z)^2, so the zero lies between z/R = 1/4 (eq. 2) and
    sqrt(n (1 + K_b)) / 4. That interval is searched from above and bisected to rounding.
    """
    n = len(positions_m)

    def excess(ratio: NDArray[np.float64] | float) -> NDArray[np.float64]:
        heights = np.broadcast_to(np.asarray(ratio, float) * radius_m, (n, *np.shape(ratio)))
        sums = denominator_sums(radius_m, heights, np.ones(n), positions_m, K_b, 1.0, body_distance)
        worst: NDArray[np.float64] = np.max(sums, axis=0) - 1.0
        return worst

    grid = np.linspace(0.25, 0.25 * np.sqrt(n * (1.0 + K_b)), 2001)
    above = np.flatnonzero(excess(grid) >= 0.0)
    last = int(above[-1]) if above.size else 0
    low, high = float(grid[last]), float(grid[min(last + 1, grid.size - 1)])
    for _ in range(60):
        middle = 0.5 * (low + high)
        if excess(middle) >= 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)
