"""Derivatives of a prediction: exact by a complex step, central differences where it must be.

f(x + ih) has imaginary part h f'(x) with no difference taken, so h may be so small that nothing
but rounding of f itself is left (Squire and Trapp, SIAM Review 40, 1998, p. 110).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from benchtool.core.array_type import Array

Way = Literal["complex_step", "central_differences"]

STEP = 1e-25  # complex step relative to the value: its square vanishes beside one

DIFFERENCE = float(np.cbrt(np.finfo(float).eps))  # relative step: truncation equals rounding
AGREEMENT = 1e-3  # part of a column's largest entry by which the two ways may differ


COMPLEX_STEP = (
    1e-100  # a search along a bound ends at numbers so small that a relative step is none
)


def _sizes(values: Array) -> Array:
    """Return what steps are relative to (n,)."""
    return np.where(np.abs(values) < COMPLEX_STEP, 1.0, np.abs(values))


def complex_step(predict: Callable[[Any], Any], values: Array, m: int) -> Array:
    """Return d prediction / d values (m, n) in one vectorised call."""
    n = len(values)
    h = STEP * _sizes(values)
    moved = np.empty((n, n, 1), complex)
    moved[:] = values[:, None, None]
    moved[np.arange(n), np.arange(n), 0] += 1j * h
    moved_prediction = np.broadcast_to(predict(moved), (n, m))
    return np.ascontiguousarray((np.imag(moved_prediction) / h[:, None]).T)


def central_differences(
    predict: Callable[[Any], Any],
    values: Array,
    m: int,
    lower: Array,
    upper: Array,
) -> Array:
    """Return d prediction / d values (m, n) in one vectorised call, steps kept in bounds."""
    n = len(values)
    h = DIFFERENCE * _sizes(values)
    above, below = np.minimum(values + h, upper), np.maximum(values - h, lower)
    moved = np.empty((n, 2 * n, 1))
    moved[:] = values[:, None, None]
    each = np.arange(n)
    moved[each, each, 0] = above
    moved[each, n + each, 0] = below
    both = np.broadcast_to(np.asarray(predict(moved), float), (2 * n, m))
    return np.ascontiguousarray(((both[:n] - both[n:]) / (above - below)[:, None]).T)


def select_method(
    predict: Callable[[Any], Any], values: Array, m: int, lower: Array, upper: Array
) -> Way:
    """Return which way is right for a function, by comparing both once at `values`."""
    plain = central_differences(predict, values, m, lower, upper)
    try:
        exact = complex_step(predict, values, m)
    except (TypeError, ValueError):
        return "central_differences"
    size = np.maximum(
        np.abs(plain).max(axis=0, initial=0.0), np.abs(exact).max(axis=0, initial=0.0)
    )
    floor = 1e-9 * np.abs(np.asarray(predict(values))).max(initial=0.0)
    floor = floor / _sizes(values)
    close = np.abs(exact - plain).max(axis=0, initial=0.0) <= AGREEMENT * size + floor
    return "complex_step" if bool(np.all(close | ~np.isfinite(size))) else "central_differences"


RANK_LIMIT: dict[Way, float] = {"complex_step": 1e-12, "central_differences": 1e-8}
"""Singular values of the column-scaled Jacobian below this part of the largest count as zero:
some digits above the rounding of the derivatives."""

PART = 1e-3  # least share of a parameter that takes part in an undetermined direction


@dataclass(frozen=True, slots=True, eq=False)
class Spread:
    """Hold what a Jacobian says of its parameters.

    Attributes:
        undetermined: positions of parameters that no finite interval can be given for.
        condition: ratio of singular values of the column-scaled Jacobian; inf when rank is short.
    """

    covariance: Array  # (n, n); infinite variance where `undetermined`
    undetermined: tuple[int, ...]
    directions: Array  # (k, n) undetermined directions in units of each parameter's own column norm
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
