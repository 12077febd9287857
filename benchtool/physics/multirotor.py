"""Any number of rotors over a plate at once: the general sum with the body term (eq. 2 to 4).

The factor of rotor i is 1 / (1 - D_i) with D_i = R^2 [1/(16 z_i^2) + sum over j != i of
a_j z_i / (2 (d_ij^2 + 4 z_i^2)^(3/2)) + K_b w sum_j z_i / (2 (c_j^2 + 4 z_i^2)^(3/2))], a_j the
covered fraction of rotor j, d_ij between axes, c_j from rotor j to the body's centre. Every rotor
enters with its own height.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchtool.physics.body_lift import BodyDistance, body_images, body_term, centre_distances_m
from benchtool.physics.expression import Quantity, expression
from benchtool.physics.images import neighbour_images, self_image, thrust_factor

Array = NDArray[np.float64]


def axis_distances_m(positions_m: Array) -> Array:
    """Return the distances between rotor axes (n, n) for positions (n, 2): m."""
    difference = positions_m[:, None, :] - positions_m[None, :, :]
    distances: Array = np.hypot(difference[..., 0], difference[..., 1])
    return distances


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


@expression
def three_rotor_corner_factor(radius_m: Quantity, z_m: Quantity, spacing_m: Quantity) -> Quantity:
    """Return the factor of the middle of three rotors on a square's corners: two neighbours at d.

    Three rotors of a quadrotor, the fourth switched off; the paper does not say whether its curve
    is one rotor's or the average (section 2.3), so both are here.
    """
    adjacent = spacing_m * spacing_m + 4.0 * z_m * z_m
    ratio = radius_m / (4.0 * z_m)
    near = radius_m * radius_m * z_m / np.sqrt(adjacent * adjacent * adjacent)
    return 1.0 / (1.0 - ratio * ratio - near)


@expression
def three_rotor_end_factor(radius_m: Quantity, z_m: Quantity, spacing_m: Quantity) -> Quantity:
    """Return the factor of either end of three: one neighbour at d, one across the diagonal."""
    adjacent = spacing_m * spacing_m + 4.0 * z_m * z_m
    opposite = 2.0 * spacing_m * spacing_m + 4.0 * z_m * z_m
    ratio = radius_m / (4.0 * z_m)
    near = 0.5 * radius_m * radius_m * z_m / np.sqrt(adjacent * adjacent * adjacent)
    far = 0.5 * radius_m * radius_m * z_m / np.sqrt(opposite * opposite * opposite)
    return 1.0 / (1.0 - ratio * ratio - near - far)


@expression
def three_rotor_average_factor(radius_m: Quantity, z_m: Quantity, spacing_m: Quantity) -> Quantity:
    """Return the thrust of all three together over its value far from the plate."""
    corner = three_rotor_corner_factor(radius_m, z_m, spacing_m)
    end = three_rotor_end_factor(radius_m, z_m, spacing_m)
    return (corner + 2.0 * end) / 3.0
