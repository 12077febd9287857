"""How partly covered rotors share the body term: model data, because nobody has measured it.

The paper measures a quadrotor with all rotors over the plate (weight 1) and says of three rotors
that they follow "the same trend with less intensity". Every rule here is a named assumption that
agrees with eq. (4) when all discs are covered. A weight function takes the covered fraction of
each disc (n, ...), 0 for a rotor that is off, and returns w (...).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchtool.core.errors import UnknownChoice
from benchtool.physics.expression import Quantity, expression


@expression
def notes_weight(coverage: Quantity) -> Quantity:
    """Return max(0, (sum a - 1) / (n - 1)); 0 for one rotor: linear from the second rotor on.

    It gives eq. (2) for one covered rotor, eq. (4) for all, two thirds for three of four ("same
    trend with less intensity", section 2.3 of the paper); assumed.
    """
    n = len(coverage)
    total = 0.0 * coverage[0]
    for j in range(n):
        total = total + coverage[j]
    return min(n - 1, 1) * np.maximum(0.0, (total - 1.0) / max(n - 1, 1))


@expression
def full_weight(coverage: Quantity) -> Quantity:
    """Return 1, however many rotors are covered: the upper bound; assumed."""
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
    """Return the product of all a: a fountain with all rotors over the plate alone; assumed."""
    product = 1.0 + 0.0 * coverage[0]
    for j in range(len(coverage)):
        product = product * coverage[j]
    return product


@expression
def pairs_weight(coverage: Quantity) -> Quantity:
    """Return the mean of a_i a_j over pairs i < j; 0 for one rotor: every pair adds alike; assumed.

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
    """Return the weight function of that name; an unknown name lists the known ones."""
    if name not in WAKE_RULES:
        raise UnknownChoice("wake rule", name, WAKE_RULES)
    return WAKE_RULES[name]
