"""Whether a class is honest, by the Fisher information of the true bench.

The criterion is the one that benchtool declares classes by; the information is not: it is worked
out here from the generator's own physics at what is true, there from a fit.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from typing import Protocol

from benchtool.explain.engine.bounded_least_squares import UNDETERMINED_HINT, evidence_against

__all__ = ["UNDETERMINED_HINT", "class_confirmed", "evidence_against"]


class Telling(Protocol):
    """What data tell about a true model."""

    def evidence(self, rivals: Iterable[str] = ()) -> float:
        """Return how clearly they speak against a model with other effects than the true ones."""
        ...


def class_confirmed(
    names: Collection[str], truth: Collection[str], told: Callable[[], Telling]
) -> bool:
    """Return whether nobody could tell the wrong members of a class from the right one.

    Args:
        names: members of the class.
        truth: what is hidden.
        told: works out the true model's information; asked only where the truth is a member.
    """
    if not set(names) & set(truth):
        return False
    information = told()
    return all(
        information.evidence([name]) < UNDETERMINED_HINT for name in names if name not in truth
    )
