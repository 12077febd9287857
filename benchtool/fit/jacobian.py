"""Derivatives of a prediction: complex step (exact), central differences as fallback.

f(x + ih) has the imaginary part h f'(x) without a subtraction, so h can be so small that only the
rounding of f itself is left (Squire and Trapp, SIAM Review 40, 1998, p. 110).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from benchtool.core.units import Array

DerivativeMethod = Literal["complex_step", "central_differences"]

STEP = 1e-25  # complex step relative to the value: its square is below the rounding of 1

RELATIVE_STEP = float(np.cbrt(np.finfo(float).eps))  # truncation error equals rounding error
MAX_DISAGREEMENT = 1e-3  # of the two methods, relative to a column's largest entry

MIN_VALUE = 1e-100  # smaller values (a search along a bound) get an absolute step


def _step_scale(values: Array) -> Array:
    """Return the scale of the steps (n,)."""
    return np.where(np.abs(values) < MIN_VALUE, 1.0, np.abs(values))


def complex_step(predict: Callable[[Any], Any], values: Array, m: int) -> Array:
    """Return d prediction / d values (m, n) in one vectorised call."""
    n = len(values)
    h = STEP * _step_scale(values)
    points = np.empty((n, n, 1), complex)
    points[:] = values[:, None, None]
    points[np.arange(n), np.arange(n), 0] += 1j * h
    predictions = np.broadcast_to(predict(points), (n, m))
    return np.ascontiguousarray((np.imag(predictions) / h[:, None]).T)


def central_differences(
    predict: Callable[[Any], Any], values: Array, m: int, lower: Array, upper: Array
) -> Array:
    """Return d prediction / d values (m, n) in one vectorised call, steps within bounds."""
    n = len(values)
    h = RELATIVE_STEP * _step_scale(values)
    above, below = np.minimum(values + h, upper), np.maximum(values - h, lower)
    points = np.empty((n, 2 * n, 1))
    points[:] = values[:, None, None]
    indices = np.arange(n)
    points[indices, indices, 0] = above
    points[indices, n + indices, 0] = below
    both = np.broadcast_to(np.asarray(predict(points), float), (2 * n, m))
    return np.ascontiguousarray(((both[:n] - both[n:]) / (above - below)[:, None]).T)


def select_method(
    predict: Callable[[Any], Any], values: Array, m: int, lower: Array, upper: Array
) -> DerivativeMethod:
    """Return the method for a function: complex step if both methods agree at `values`."""
    differences = central_differences(predict, values, m, lower, upper)
    try:
        exact = complex_step(predict, values, m)
    except (TypeError, ValueError):
        return "central_differences"
    scale = np.maximum(
        np.abs(differences).max(axis=0, initial=0.0), np.abs(exact).max(axis=0, initial=0.0)
    )
    floor = 1e-9 * np.abs(np.asarray(predict(values))).max(initial=0.0)
    floor = floor / _step_scale(values)
    gap = np.abs(exact - differences).max(axis=0, initial=0.0)
    is_close = gap <= MAX_DISAGREEMENT * scale + floor
    return "complex_step" if bool(np.all(is_close | ~np.isfinite(scale))) else "central_differences"


# Singular values of the column-scaled Jacobian below this share of the largest count as zero; some
# digits above the rounding of the derivatives.
RANK_LIMIT: dict[DerivativeMethod, float] = {"complex_step": 1e-12, "central_differences": 1e-8}
PART = 1e-3  # minimum component of a parameter that belongs to an undetermined direction


@dataclass(frozen=True, slots=True, eq=False)
class CovarianceEstimate:
    """Covariance and rank of a weighted Jacobian.

    Attributes:
        undetermined: indices of parameters without a finite interval.
        condition: ratio of singular values of the column-scaled Jacobian; inf if rank deficient.
    """

    covariance: Array  # (n, n); infinite variance where `undetermined`
    undetermined: tuple[int, ...]
    directions: Array  # (k, n) undetermined directions in units of each parameter's column norm
    condition: float


def estimate_covariance(
    jacobian: Array, method: DerivativeMethod = "complex_step"
) -> CovarianceEstimate:
    """Return covariance (J^T J)^-1 and rank of a weighted Jacobian (rows, n), by its SVD."""
    n = jacobian.shape[1]
    norms = np.linalg.norm(jacobian, axis=0)
    is_zero = ~(norms > 0.0)
    norms = np.where(is_zero, 1.0, norms)
    rows = jacobian / norms
    if rows.shape[0] < n:
        rows = np.concatenate([rows, np.zeros((n - rows.shape[0], n))])
    _, singular, directions = np.linalg.svd(rows, full_matrices=False)
    is_null = singular <= RANK_LIMIT[method] * singular[0]
    inverse = np.where(is_null, 0.0, 1.0 / np.where(is_null, 1.0, singular))
    factor = directions.T * inverse / norms[:, None]
    covariance = factor @ factor.T
    undetermined = np.flatnonzero((np.abs(directions[is_null]) > PART).any(axis=0))
    for i in undetermined:
        covariance[i, :] = covariance[:, i] = 0.0
        covariance[i, i] = np.inf
    return CovarianceEstimate(
        covariance=covariance,
        undetermined=tuple(int(i) for i in undetermined),
        directions=directions[is_null],
        condition=float("inf") if is_null.any() else float(singular[0] / singular[-1]),
    )
