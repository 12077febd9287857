"""The general sum of eqs. (2) to (4) written down once more, to check the package against.

The factor of rotor i is 1 / (1 - D_i) with D_i = R^2 [1/(16 z_i^2) + sum over j != i of
a_j z_i / (2 (d_ij^2 + 4 z_i^2)^(3/2)) + K_b w sum_j z_i / (2 (c_j^2 + 4 z_i^2)^(3/2))], a_j the
covered fraction of rotor j, d_ij between axes, c_j from rotor j to the body's centre. Every rotor
enters with its own height.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchtool.physics.body_lift import BodyDistance, body_term, centre_distances_m
from benchtool.physics.expression import Quantity, expression
from benchtool.physics.images import image_velocity, self_image, thrust_factor

Array = NDArray[np.float64]


def axis_distances_m(positions_m: Array) -> Array:
    """Return the distances between rotor axes (n, n) for positions (n, 2): m."""
    difference = positions_m[:, None, :] - positions_m[None, :, :]
    distances: Array = np.hypot(difference[..., 0], difference[..., 1])
    return distances


@expression
def neighbour_images(i: int, z_m: Quantity, coverage: Quantity, distance_m: Quantity) -> Quantity:
    """Return what the images of all other rotors contribute at rotor i per R^2 (eq. 3): 1/m2.

    Args:
        i: the rotor.
        z_m: height of each rotor (n, ...): m; the rotor's own one enters.
        coverage: fraction of each disc over the plate (n, ...), 0 for a rotor that is off.
        distance_m: array of horizontal distances between axes (n, n): m.
    """
    total = 0.0 * z_m[i]
    for j in range(len(coverage)):
        other = 1.0 - 1.0 * (j == i)
        total = total + other * coverage[j] * image_velocity(z_m[i], distance_m[i, j])
    return total


@expression
def body_images(z_m: Quantity, centre_distance_m: Quantity) -> Quantity:
    """Return what all images contribute at the body's centre, per R^2 and K_b: 1/m2.

    Args:
        z_m: height of the rotor whose thrust is asked for (...): m.
        centre_distance_m: distance of each rotor's image to the centre (n, ...): m; see
            `centre_distances_m`.
    """
    total = 0.0 * z_m
    for j in range(len(centre_distance_m)):
        total = total + image_velocity(z_m, centre_distance_m[j])
    return total


def denominator_sums(
    radius_m: Quantity,
    z_m: Quantity,
    coverage: Quantity,
    positions_m: Array,
    K_b: Quantity = 0.0,
    body_weight: Quantity = 1.0,
    body_distance: BodyDistance = "half_diagonal",
) -> Quantity:
    """Return D_i (n, ...), what is taken from 1 in the denominator of each rotor's factor.

    Args:
        radius_m: rotor radius: m.
        z_m: height of each rotor above the plate (n, ...): m.
        coverage: covered fraction of each disc (n, ...), 0 for a rotor that is off.
        positions_m: rotor axes about the body's centre (n, 2): m.
        K_b: body lift coefficient; 0 leaves the body out (eq. 3).
        body_weight: share of the body term that the wake rule grants (...).
        body_distance: which b of eq. (4).
    """
    distances = axis_distances_m(positions_m)
    arms = centre_distances_m(positions_m[:, 0], positions_m[:, 1], body_distance)
    sums = []
    for i in range(len(positions_m)):
        images = self_image(z_m[i]) + neighbour_images(i, z_m, coverage, distances)
        body = body_term(K_b, body_weight, radius_m, body_images(z_m[i], arms))
        sums.append(radius_m * radius_m * images + body)
    return np.array(sums)


def multirotor_factors(
    radius_m: Quantity,
    z_m: Quantity,
    coverage: Quantity,
    positions_m: Array,
    K_b: Quantity = 0.0,
    body_weight: Quantity = 1.0,
    body_distance: BodyDistance = "half_diagonal",
) -> Quantity:
    """Return T_IGE/T_OGE (n, ...) of each rotor's covered part; arguments as `denominator_sums`.

    A disc that is covered in part gets `partial_factor(factor, coverage)`.
    """
    sums = denominator_sums(radius_m, z_m, coverage, positions_m, K_b, body_weight, body_distance)
    return thrust_factor(sums)


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
