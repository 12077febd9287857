"""Independent implementation of the sum of eqs. (2) to (4) with vectors, as a reference.

World axes, the ground at 0. Rotor j is at P_j = (X_j, Y_j, z_j), its image at (X_j, Y_j, -z_j).
With r_ij from the image of rotor j to rotor i, n the unit vector along which the inflow is taken,
and a_j the covered fraction of rotor j (a_i = 1), rotor i's factor is 1 / (1 - D_i) with D_i =
(R^2/4) [sum_j a_j r_ij.n / |r_ij|^3 + K_b w sum_j r_cj.n / |r_cj|^3], r_cj to the body's centre.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def rotate_positions(positions_m: Array, z_m: Array, pitch_rad: Array) -> Array:
    """Return positions in the rotor plane (n, 2) in world axes (n, 3, ...): m, pitched nose down
    about a centre at height z (...).
    """
    z, pitch = np.broadcast_arrays(np.asarray(z_m, float), np.asarray(pitch_rad, float))
    return np.array(
        [[x * np.cos(pitch), y + 0.0 * z, z - x * np.sin(pitch)] for x, y in positions_m]
    )


def velocity(point_m: Array, source_m: Array, along: Array) -> Array:
    """Return r.n / (4 |r|^3) (...), r from the image of a source (3, ...) to a point (3, ...)."""
    mirrored = source_m.copy()
    mirrored[2] *= -1.0
    r = point_m - mirrored
    value: Array = 0.25 * np.einsum("k...,k...->...", r, along) / np.sqrt((r * r).sum(axis=0)) ** 3
    return value


def denominator_sums(
    radius_m: float,
    z_m: Any,
    coverage: Array,
    positions_m: Array,
    K_b: float = 0.0,
    body_weight: Any = 1.0,
    body_distance: str = "half_diagonal",
    pitch_rad: Any = 0.0,
    vertical: bool = False,
) -> Array:
    """Return D_i (n, ...), the sum of terms in the denominator 1 - D_i of each rotor.

    Args:
        radius_m: rotor radius: m.
        z_m: height of the body's centre above the plate (...): m.
        coverage: covered fraction of each disc (n, ...), 0 for a stopped rotor.
        positions_m: rotor axes about the body's centre (n, 2): m.
        K_b: body lift coefficient; 0 for eq. (3).
        body_weight: weight of the body term from the wake rule (...).
        body_distance: definition of b in eq. (4).
        pitch_rad: nose down (...).
        vertical: evaluate the inflow along the vertical, not the rotor axis.
    """
    positions = rotate_positions(positions_m, z_m, pitch_rad)
    scale = 2.0 if body_distance == "diagonal" else 1.0
    sources = rotate_positions(scale * positions_m, z_m, pitch_rad)
    centre = rotate_positions(np.zeros((1, 2)), z_m, pitch_rad)[0]
    tilt = 0.0 * centre[2] + (0.0 if vertical else np.asarray(pitch_rad, float))
    along = np.array([np.sin(tilt), 0.0 * tilt, np.cos(tilt)])
    body = sum(velocity(centre, source, along) for source in sources)
    sums = []
    for i, point in enumerate(positions):
        shares = [1.0 if j == i else coverage[j] for j in range(len(positions))]
        images = sum(a * velocity(point, p, along) for a, p in zip(shares, positions, strict=True))
        sums.append(radius_m * radius_m * (images + K_b * body_weight * body))
    return np.array(sums)


def multirotor_factors(*args: Any, **kwargs: Any) -> Array:
    """Return T_IGE/T_OGE (n, ...) of each rotor's covered part; arguments as `denominator_sums`.

    For partial coverage use `partial_factor(factor, coverage)`.
    """
    factors: Array = 1.0 / (1.0 - denominator_sums(*args, **kwargs))
    return factors


def pole_z_over_R(
    radius_m: float, positions_m: Array, K_b: float = 0.0, body_distance: str = "half_diagonal"
) -> float:
    """Return the largest z/R at which some rotor's denominator vanishes, all discs covered.

    Each image contributes at most (R/4z)^2, so the zero lies between z/R = 1/4 (eq. 2) and
    sqrt(n (1 + K_b)) / 4. That interval is searched from above and bisected to rounding.
    """
    n = len(positions_m)

    def excess(ratio: Array | float) -> Array:
        heights = np.asarray(ratio, float) * radius_m
        sums = denominator_sums(radius_m, heights, np.ones(n), positions_m, K_b, 1.0, body_distance)
        maximum: Array = np.max(sums, axis=0) - 1.0
        return maximum

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
