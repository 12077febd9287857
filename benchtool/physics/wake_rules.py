"""Weight of the body term for partial coverage: assumptions, without measurements.

The paper measures a quadrotor with all rotors over the plate (weight 1) and reports for three
rotors "the same trend with less intensity". All rules agree with eq. (4) for full coverage. A
weight function takes the coverage of each disc (n, ...), 0 for a stopped rotor, and returns
w (...).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchtool.core.errors import UnknownChoice
from benchtool.physics.expression import Quantity, expression


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
