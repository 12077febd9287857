"""How clearly data speak against other explanations, from the true model's Fisher information."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky
from scipy.optimize import lsq_linear

Array = NDArray[np.float64]

CANNOT_TELL = 25.0
"""Twice the log-likelihood ratio that the truth has on average over a rival, by the true model's
own information, below which a class of the two is an honest answer."""


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
    return all(information.evidence([name]) < CANNOT_TELL for name in names if name not in truth)


def evidence(matrix: Array, sizes: Array, low: Array, high: Array) -> float:
    """Return twice the log-likelihood ratio that the truth has on average, to second order.

    It is taken over the best model within bounds: of rivals that are free, of everything else, the
    true effects too, within its tolerance. Below some units nobody could tell the two apart.

    Args:
        matrix: (k, k) Fisher information, each number in tolerances of its own.
        sizes: (k,) true values, in tolerances past neutral.
        low, high: (k,) bounds of the rival model, in tolerances past neutral.
    """
    told = np.diag(matrix)
    scale = 1.0 / np.sqrt(np.where(told > 0.0, told, 1.0))
    root = cholesky(scale[:, None] * matrix * scale + 1e-10 * np.eye(len(sizes)))
    lowest, highest = (low - sizes) / scale, (high - sizes) / scale
    # Equal bounds have no inside; a hair's breadth does no harm.
    highest = np.maximum(highest, lowest + 1e-9)
    best = lsq_linear(root, np.zeros(len(sizes)), bounds=(lowest, highest), method="bvls")
    return 2.0 * float(best.cost)
