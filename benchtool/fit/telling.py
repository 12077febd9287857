"""How clearly data speak against a rival model, from the Fisher information of the true one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky
from scipy.optimize import lsq_linear

Array = NDArray[np.float64]

CANNOT_TELL = 25.0
"""Twice the log-likelihood ratio that the truth has on average over a rival, by the true model's
own information, below which the two are called a class. Such a ratio scatters by twice its root:
from one of 25 a single recording may well see no more than 10, which decides nothing."""


def evidence(matrix: Array, sizes: Array, low: Array, high: Array) -> float:
    """Return twice the log-likelihood ratio that the truth has on average, to second order.

    It is taken over the best model within bounds: of rivals that are free, of everything else, the
    true effects too, within its tolerance. Below some units nobody could tell the two apart.

    Args:
        matrix: (k, k) Fisher information, each number in tolerances of its own.
        sizes: (k,) true values, in tolerances past neutral.
        low: (k,) lower bounds of the rival model, in tolerances past neutral.
        high: (k,) upper bounds.
    """
    told = np.diag(matrix)
    scale = 1.0 / np.sqrt(np.where(told > 0.0, told, 1.0))
    root = cholesky(scale[:, None] * matrix * scale + 1e-10 * np.eye(len(sizes)))
    lowest, highest = (low - sizes) / scale, (high - sizes) / scale
    # Equal bounds have no inside; a hair's breadth does no harm.
    highest = np.maximum(highest, lowest + 1e-9)
    best = lsq_linear(root, np.zeros(len(sizes)), bounds=(lowest, highest), method="bvls")
    return 2.0 * float(best.cost)
