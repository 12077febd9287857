"""Covariance from a Jacobian, telling which parameters the data do not determine."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.fit.jacobian import Way

Array = NDArray[np.float64]

RANK_LIMIT: dict[Way, float] = {"complex_step": 1e-12, "central_differences": 1e-8}
"""Singular values of the column-scaled Jacobian below this part of the largest count as zero:
some digits above the rounding of the derivatives."""

PART = 1e-3
"""A parameter takes part in an undetermined direction when its share is larger than this."""


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Hold what a Jacobian says of its parameters.

    Attributes:
        covariance: (n, n); infinite variance where `undetermined`.
        undetermined: positions of parameters that no finite interval can be given for.
        directions: (k, n) undetermined directions in units of each parameter's own column norm.
        condition: ratio of singular values of the column-scaled Jacobian; inf when rank is short.
    """

    covariance: Array
    undetermined: tuple[int, ...]
    directions: Array
    condition: float


def spread_of(jacobian: Array, way: Way = "complex_step") -> Spread:
    """Return covariance (J^T J)^-1 and rank of a weighted Jacobian (rows, n), by its SVD."""
    n = jacobian.shape[1]
    norms = np.linalg.norm(jacobian, axis=0)
    dead = ~(norms > 0.0)
    norms = np.where(dead, 1.0, norms)
    rows = jacobian / norms
    if rows.shape[0] < n:
        rows = np.concatenate([rows, np.zeros((n - rows.shape[0], n))])
    _, singular, directions = np.linalg.svd(rows, full_matrices=False)
    short = singular <= RANK_LIMIT[way] * singular[0]
    inverse = np.where(short, 0.0, 1.0 / np.where(short, 1.0, singular))
    half = directions.T * inverse / norms[:, None]
    covariance = half @ half.T
    undetermined = np.flatnonzero((np.abs(directions[short]) > PART).any(axis=0))
    for i in undetermined:
        covariance[i, :] = covariance[:, i] = 0.0
        covariance[i, i] = np.inf
    return Spread(
        covariance=covariance,
        undetermined=tuple(int(i) for i in undetermined),
        directions=directions[short],
        condition=float("inf") if short.any() else float(singular[0] / singular[-1]),
    )
