"""Lift of the body in the upwash between the rotors: the added term of eq. (4).

The term is the velocity of all images at the body's centre, times an empirical K_b ("close to 2").
Its factor 2 R^2 is four images at half the diagonal, so the derivation asks for b = half the
diagonal; the paper's text calls b the diagonal. Both readings are here: half is the default.
"""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import UnknownChoice
from benchtool.physics.expression import Quantity, expression

BodyDistance = Literal["half_diagonal", "diagonal"]
"""Which b of eq. (4): from the centre to a rotor axis, or twice that (as printed)."""


@expression
def body_term(K_b: Quantity, weight: Quantity, radius_m: Quantity, images: Quantity) -> Quantity:
    """Return the body's term of the denominator, K_b w R^2 sum_j z / (2 (c_j^2 + 4 z^2)^(3/2)).

    Args:
        K_b: body lift coefficient (eq. 4).
        weight: share w that the wake rule grants (`wake_rules`); 1 when all rotors are covered.
        radius_m: rotor radius: m.
        images: what all images contribute at the body's centre, per R^2 (`disc_thrust`): 1/m2.
    """
    return K_b * weight * radius_m * radius_m * images


@expression
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


def centre_distances_m(
    x_m: NDArray[np.float64],
    y_m: NDArray[np.float64],
    body_distance: BodyDistance = "half_diagonal",
) -> NDArray[np.float64]:
    """Return c_j (n,) for rotors at (x, y) (n,) about the body's centre: m.

    Works for any layout: "half_diagonal" is the distance from centre to axis, "diagonal" twice it.
    """
    if body_distance not in get_args(BodyDistance):
        raise UnknownChoice("body distance", body_distance, get_args(BodyDistance))
    arms: NDArray[np.float64] = np.hypot(x_m, y_m)
    return 2.0 * arms if body_distance == "diagonal" else arms


def equal_arms(arms_m: NDArray[np.float64]) -> tuple[int, ...]:
    """Return of each arm (n,) how many are equal to rounding, 0 where an earlier one counts it."""
    equal = np.isclose(arms_m[:, None], arms_m, rtol=1e-12, atol=0.0)
    first = equal.argmax(axis=1)
    return tuple(np.bincount(first, minlength=len(arms_m)).tolist())
