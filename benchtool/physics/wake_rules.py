"""How partly covered rotors share the body term: model data, because nobody has measured it.

The paper measures a quadrotor with all rotors over the plate (weight 1) and says of three rotors
that they follow "the same trend with less intensity". Every rule here is a named assumption that
agrees with eq. (4) when all discs are covered. A weight function takes the covered fraction of
each disc (n, ...), 0 for a rotor that is off, and returns w (...).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchtool.core.errors import UnknownChoice
from benchtool.physics.expression import Quantity, expression


@dataclass(frozen=True, slots=True)
class Rule:
    """Name one assumption about the shared wake."""

    name: str
    weight: Callable[[Quantity], Quantity]
    assumption: str
    source: str


@expression
def notes_weight(coverage: Quantity) -> Quantity:
    """Return max(0, (sum a - 1) / (n - 1)); 0 for one rotor."""
    n = len(coverage)
    total = 0.0 * coverage[0]
    for j in range(n):
        total = total + coverage[j]
    return min(n - 1, 1) * np.maximum(0.0, (total - 1.0) / max(n - 1, 1))


@expression
def full_weight(coverage: Quantity) -> Quantity:
    """Return 1."""
    return 1.0 + 0.0 * coverage[0]


@expression
def mean_weight(coverage: Quantity) -> Quantity:
    """Return sum a / n."""
    n = len(coverage)
    total = 0.0 * coverage[0]
    for j in range(n):
        total = total + coverage[j]
    return total / n


@expression
def product_weight(coverage: Quantity) -> Quantity:
    """Return the product of all a."""
    product = 1.0 + 0.0 * coverage[0]
    for j in range(len(coverage)):
        product = product * coverage[j]
    return product


@expression
def pairs_weight(coverage: Quantity) -> Quantity:
    """Return the mean of a_i a_j over pairs i < j; 0 for one rotor."""
    n = len(coverage)
    total = 0.0 * coverage[0]
    squares = 0.0 * coverage[0]
    for j in range(n):
        total = total + coverage[j]
        squares = squares + coverage[j] * coverage[j]
    return (total * total - squares) / max(n * (n - 1), 1) * min(n - 1, 1)


_RULES = (
    Rule(
        "notes",
        notes_weight,
        "the body term grows linearly from the second covered rotor on: w = (sum a - 1)/(n - 1)",
        "assumed; gives eq. (2) for one covered rotor, eq. (4) for all, two thirds for three of "
        "four ('same trend with less intensity', section 2.3 of the paper)",
    ),
    Rule(
        "full",
        full_weight,
        "the body term does not depend on how many rotors are covered: w = 1",
        "assumed; the upper bound",
    ),
    Rule(
        "mean",
        mean_weight,
        "every covered rotor adds an equal share of the body term: w = sum a / n",
        "assumed; superposition of the images at the centre",
    ),
    Rule(
        "product",
        product_weight,
        "there is a fountain only with all rotors over the plate: w = product of a",
        "assumed; the lower bound",
    ),
    Rule(
        "pairs",
        pairs_weight,
        "every pair of covered rotors adds an equal share: w = mean of a_i a_j over pairs",
        "assumed; the fountain 'arises when a pair of rotors' is near the ground (section 2.2)",
    ),
)

WAKE_RULES: dict[str, Rule] = {rule.name: rule for rule in _RULES}


def wake_rule(name: str) -> Rule:
    """Return the rule of that name; an unknown name lists the known ones."""
    if name not in WAKE_RULES:
        raise UnknownChoice("wake rule", name, WAKE_RULES)
    return WAKE_RULES[name]
