"""Closed formulas of the paper as printed: eqs. (2) to (4)."""

from __future__ import annotations

import numpy as np

from benchtool.physics.expression import Quantity


def single_rotor_factor(radius_m: Quantity, z_m: Quantity) -> Quantity:
    """Return eq. (2) as printed: 1 / (1 - (R/4z)^2)."""
    ratio = radius_m / (4.0 * z_m)
    return 1.0 / (1.0 - ratio * ratio)


def quad_factor(radius_m: Quantity, z_m: Quantity, spacing_m: Quantity) -> Quantity:
    """Return eq. (3) as printed: a quadrotor, d = `spacing_m` between adjacent axes."""
    ratio = radius_m / (4.0 * z_m)
    adjacent = spacing_m * spacing_m + 4.0 * z_m * z_m
    opposite = 2.0 * spacing_m * spacing_m + 4.0 * z_m * z_m
    return 1.0 / (
        1.0
        - ratio * ratio
        - radius_m * radius_m * (z_m / np.sqrt(adjacent * adjacent * adjacent))
        - 0.5 * radius_m * radius_m * (z_m / np.sqrt(opposite * opposite * opposite))
    )


def quad_body_lift_factor(
    radius_m: Quantity, z_m: Quantity, spacing_m: Quantity, b_m: Quantity, K_b: Quantity
) -> Quantity:
    """Return eq. (4) as printed: eq. (3) with the body term 2 R^2 z / (b^2 + 4 z^2)^(3/2) K_b.

    Args:
        radius_m: rotor radius R: m.
        z_m: height of the rotor plane: m.
        spacing_m: distance d between adjacent axes: m.
        b_m: d/sqrt(2) as derived, d sqrt(2) as the text defines it: m.
        K_b: body lift coefficient.
    """
    ratio = radius_m / (4.0 * z_m)
    adjacent = spacing_m * spacing_m + 4.0 * z_m * z_m
    opposite = 2.0 * spacing_m * spacing_m + 4.0 * z_m * z_m
    body = b_m * b_m + 4.0 * z_m * z_m
    return 1.0 / (
        1.0
        - ratio * ratio
        - radius_m * radius_m * (z_m / np.sqrt(adjacent * adjacent * adjacent))
        - 0.5 * radius_m * radius_m * (z_m / np.sqrt(opposite * opposite * opposite))
        - 2.0 * radius_m * radius_m * (z_m / np.sqrt(body * body * body)) * K_b
    )


def three_rotor_corner_factor(radius_m: Quantity, z_m: Quantity, spacing_m: Quantity) -> Quantity:
    """Return the factor of the middle of three rotors at corners of a square: two neighbours at d.

    Three rotors of a quadrotor, the fourth stopped. The paper does not define whether its curve is
    of one rotor or the average (section 2.3), so both are available.
    """
    adjacent = spacing_m * spacing_m + 4.0 * z_m * z_m
    ratio = radius_m / (4.0 * z_m)
    near = radius_m * radius_m * z_m / np.sqrt(adjacent * adjacent * adjacent)
    return 1.0 / (1.0 - ratio * ratio - near)


def three_rotor_end_factor(radius_m: Quantity, z_m: Quantity, spacing_m: Quantity) -> Quantity:
    """Return the factor of either end of three: one neighbour at d, one across the diagonal."""
    adjacent = spacing_m * spacing_m + 4.0 * z_m * z_m
    opposite = 2.0 * spacing_m * spacing_m + 4.0 * z_m * z_m
    ratio = radius_m / (4.0 * z_m)
    near = 0.5 * radius_m * radius_m * z_m / np.sqrt(adjacent * adjacent * adjacent)
    far = 0.5 * radius_m * radius_m * z_m / np.sqrt(opposite * opposite * opposite)
    return 1.0 / (1.0 - ratio * ratio - near - far)


def three_rotor_average_factor(radius_m: Quantity, z_m: Quantity, spacing_m: Quantity) -> Quantity:
    """Return the total thrust of the three rotors over that out of ground effect."""
    corner = three_rotor_corner_factor(radius_m, z_m, spacing_m)
    end = three_rotor_end_factor(radius_m, z_m, spacing_m)
    return (corner + 2.0 * end) / 3.0
