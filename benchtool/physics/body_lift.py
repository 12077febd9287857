"""Body lift in the upwash between the rotors: positions and weight of the added term of eq. (4).

The term is the velocity of all images at the body's centre (`effects.body_lift`), times an
empirical K_b ("close to 2").
Its factor 2 R^2 corresponds to four images at half the diagonal, so b is half the diagonal by the
derivation; the paper's text calls b the diagonal. Both are available, half is the default.

The weight for partial coverage is assumed, without measurements. The paper measures a quadrotor
with all rotors over the plate (weight 1) and reports for three rotors "the same trend with less
intensity". All rules agree with eq. (4) for full coverage. A weight function takes the coverage of
each disc (n, ...), 0 for a stopped rotor, and returns w (...).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, NamedTuple, get_args

import numpy as np

from benchtool.core.errors import UnknownChoice
from benchtool.core.units import Array
from benchtool.physics.expression import Quantity, expression

BodyDistance = Literal["half_diagonal", "diagonal"]  # b of eq. (4): to a rotor axis, or twice that


class BodyImages(NamedTuple):
    """Positions of the body term's sources in the rotor plane, and their distances (k,): m."""

    x_m: Quantity
    y_m: Quantity
    arm_m: Quantity


def body_images(
    x_m: Array,
    y_m: Array,
    body_distance: BodyDistance = "half_diagonal",
    half_diagonal_m: float | None = None,
) -> BodyImages:
    """Return the sources of the body term for rotors at (x, y) (n,) about the body's centre.

    For any layout: "half_diagonal" places them at the rotors, "diagonal" at twice their arms, in
    the same plane. With `half_diagonal_m` they are the four rotors of a plus layout.
    """
    if body_distance not in get_args(BodyDistance):
        raise UnknownChoice("body distance", body_distance, get_args(BodyDistance))
    if half_diagonal_m is not None:
        x_m = half_diagonal_m * np.array([1.0, 0.0, -1.0, 0.0])
        y_m = np.roll(x_m, 1)
    factor = 2.0 if body_distance == "diagonal" else 1.0
    return BodyImages(factor * x_m, factor * y_m, factor * np.hypot(x_m, y_m))


@expression
def notes_weight(coverage: Quantity) -> Quantity:
    """Return max(0, (sum a - 1) / (n - 1)), linear from the second rotor; 0 for one rotor; assumed.

    The result is eq. (2) for one covered rotor, eq. (4) for all, and two thirds of the body term
    for three of four ("same trend with less intensity", section 2.3 of the paper).
    """
    n = len(coverage)
    total = 0.0 * coverage[0]
    for j in range(n):
        total = total + coverage[j]
    return min(n - 1, 1) * np.maximum(0.0, (total - 1.0) / max(n - 1, 1))


@expression
def full_weight(coverage: Quantity) -> Quantity:
    """Return 1 for any number of covered rotors: upper bound; assumed."""
    return 1.0 + 0.0 * coverage[0]


@expression
def mean_weight(coverage: Quantity) -> Quantity:
    """Return sum a / n: superposition of the images at the centre; assumed."""
    n = len(coverage)
    total = 0.0 * coverage[0]
    for j in range(n):
        total = total + coverage[j]
    return total / n


@expression
def product_weight(coverage: Quantity) -> Quantity:
    """Return the product of all a: no fountain unless all rotors are over the plate; assumed."""
    product = 1.0 + 0.0 * coverage[0]
    for j in range(len(coverage)):
        product = product * coverage[j]
    return product


@expression
def pairs_weight(coverage: Quantity) -> Quantity:
    """Return the mean of a_i a_j over pairs i < j, all pairs equal; 0 for one rotor; assumed.

    The fountain "arises when a pair of rotors" is near the ground (section 2.2 of the paper).
    """
    n = len(coverage)
    total = 0.0 * coverage[0]
    squares = 0.0 * coverage[0]
    for j in range(n):
        total = total + coverage[j]
        squares = squares + coverage[j] * coverage[j]
    return (total * total - squares) / max(n * (n - 1), 1) * min(n - 1, 1)


WAKE_RULES: dict[str, Callable[[Quantity], Quantity]] = {
    "notes": notes_weight,
    "full": full_weight,
    "mean": mean_weight,
    "product": product_weight,
    "pairs": pairs_weight,
}


def wake_rule(name: str) -> Callable[[Quantity], Quantity]:
    """Return the weight function of that name."""
    if name not in WAKE_RULES:
        raise UnknownChoice("wake rule", name, WAKE_RULES)
    return WAKE_RULES[name]
