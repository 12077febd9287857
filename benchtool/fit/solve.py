"""Weighted nonlinear least squares: derivatives, minimum, covariance.

Derivatives are by complex step (exact), with central differences as fallback. f(x + ih) has the
imaginary part h f'(x) without a subtraction, so h can be so small that only the rounding of f
itself is left (Squire and Trapp, SIAM Review 40, 1998, p. 110). The minimum is by Gauss-Newton
steps while they shrink; where they do not, by scipy's optimiser with Gauss-Newton polish.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy.optimize import least_squares

from benchtool.core.choices import Loss
from benchtool.core.error_source import Whitening
from benchtool.core.errors import EstimationError
from benchtool.core.units import Array
from benchtool.fit.problem import Problem
from benchtool.fit.statistics import point_losses

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


def derivatives(
    predict: Callable[[Any], Any],
    values: Array,
    m: int,
    bounds: tuple[Array, Array],
    method: DerivativeMethod,
) -> Array:
    """Return d prediction / d values (m, n) by a method."""
    if method == "complex_step":
        return complex_step(predict, values, m)
    return central_differences(predict, values, m, *bounds)


# Singular values of the column-scaled Jacobian below this share of the largest count as zero; some
# digits above the rounding of the derivatives.
RANK_LIMIT: dict[DerivativeMethod, float] = {"complex_step": 1e-12, "central_differences": 1e-8}
PART = 1e-3  # minimum component of a parameter that belongs to an undetermined direction


@dataclass(frozen=True, slots=True, eq=False)
class CovarianceEstimate:
    """Covariance and rank of a weighted Jacobian."""

    covariance: Array  # (n, n); infinite variance where `undetermined`
    undetermined: tuple[int, ...]  # indices of parameters without a finite interval
    directions: Array  # (k, n) undetermined directions in units of each parameter's column norm
    condition: float  # of the column-scaled Jacobian; inf if rank deficient


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


TOLERANCE = 1e-10  # relative change of cost and step below which the polish takes over
POLISH = 1e-8  # converged below this Gauss-Newton step, in standard deviations
POLISH_STEPS = 12  # maximum; a step that does not shrink is rounding and ends the polish


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Minimum of a weighted least-squares problem.

    Under a robust loss the r shared errors are parameters: rows of points are residuals over their
    independent errors, and the values of the shared errors follow as rows and parameters.
    """

    shape: Array  # (n_shape,) values
    rows: Array  # (m + q [+ r],) whitened residuals there
    jacobian: Array  # (m + q [+ r], n_shape [+ r]) of the rows, without the loss
    cost: float  # half the sum of squares, after the loss
    finished: bool  # True if a tolerance was met
    evaluations: int  # of the prediction; a Jacobian counts as one
    method: DerivativeMethod  # method of derivatives

    @property
    def chi2(self) -> float:
        """Sum of squared rows."""
        return float(self.rows @ self.rows)

    def points_dof(self, m: int) -> float:
        """Return the degrees of freedom of the rows of m points: m minus their leverages."""
        return m - float(np.sum(np.linalg.qr(self.jacobian)[0][:m] ** 2))


def derivative_method(problem: Problem, shape: Array) -> DerivativeMethod:
    """Return the method for the derivatives of a problem's prediction."""
    return select_method(problem.predict, shape, len(problem), *problem.shape_bounds)


def prediction_jacobian(problem: Problem, method: DerivativeMethod, shape: Array) -> Array:
    """Return d prediction / d shape (m, n_shape)."""
    return derivatives(problem.predict, shape, len(problem), problem.shape_bounds, method)


def row_jacobian(
    problem: Problem, method: DerivativeMethod, shape: Array, whitening: Whitening
) -> Array:
    """Return d rows / d shape (m + q, n_shape)."""
    data = whitening(prediction_jacobian(problem, method, shape))
    return np.concatenate([data, problem.priors.matrix]) if len(problem.priors) else data


def solve(
    problem: Problem,
    whitening: Whitening,
    start: Array | None = None,
    *,
    loss: Loss = "linear",
    method: DerivativeMethod | None = None,
) -> Solution:
    """Return the minimum of a problem.

    Args:
        start: (n_shape,) initial values; None means those of the problem.
        loss: of the points, not of priors. Under a robust loss each shared error is a parameter
            with the prior N(0, 1), so that an outlier does not change rows of other points.
        method: method of derivatives; selected by default.
    """
    lower, upper = problem.shape_bounds
    initial = np.clip(problem.start if start is None else start, lower, upper)
    with np.errstate(all="ignore"):
        first = problem.rows(initial, whitening)
        bad = np.flatnonzero(~np.isfinite(first[: len(problem)]))
        if bad.size:
            raise EstimationError(
                f"the model has no finite prediction for {problem.label(int(bad[0]))} (and "
                f"{bad.size - 1} more) at the initial values; change these or remove the point"
            )
        if method is None:
            method = derivative_method(problem, initial)
        if loss == "linear":
            slopes_0, cost_0 = row_jacobian(problem, method, initial, whitening), first @ first / 2
            solution = Solution(initial, first, slopes_0, float(cost_0), False, 2, method)
            solution = _polish(problem, whitening, solution)
            if solution.finished:
                return solution
        n, draws = len(initial), np.zeros(0 if loss == "linear" else whitening.shared.shape[1])
        independent = whitening if loss == "linear" else whitening.independent
        shared = np.zeros((len(first) + len(draws), len(draws)))
        if len(draws):
            shared[: len(problem)], shared[len(first) :] = whitening.shared, np.eye(len(draws))

        def rows(point: Array) -> Array:
            data = np.concatenate([problem.rows(point[:n], independent), np.zeros(len(draws))])
            return np.asarray(data + shared @ point[n:])

        def slopes(point: Array) -> Array:
            data = row_jacobian(problem, method, point[:n], independent)
            data = np.pad(data, ((0, len(draws)), (0, 0)))
            return np.concatenate([data, shared], axis=1)

        scipy_loss: Any = loss if loss == "linear" else point_losses(loss, len(problem))
        minimum: Any = least_squares(
            rows,
            np.concatenate([initial, draws]),
            jac=slopes,
            bounds=(
                np.concatenate([lower, draws - np.inf]),
                np.concatenate([upper, draws + np.inf]),
            ),
            method="trf",
            x_scale="jac",
            ftol=TOLERANCE,
            xtol=TOLERANCE,
            gtol=None,
            loss=scipy_loss,
            max_nfev=200 * len(initial),
        )
        solution = Solution(
            shape=np.asarray(minimum.x[:n], float),
            rows=np.asarray(minimum.fun, float),
            jacobian=np.asarray(minimum.jac) if loss == "linear" else slopes(minimum.x),
            cost=float(minimum.cost),
            finished=minimum.status > 0,
            evaluations=int(minimum.nfev) + int(minimum.njev),
            method=method,
        )
        if loss != "linear":
            return solution
        polished = _polish(problem, whitening, solution)
        return replace(polished, finished=solution.finished)


def _polish(problem: Problem, whitening: Whitening, solution: Solution) -> Solution:
    """Return the solution after Gauss-Newton steps, taken while they shrink and stay in bounds.

    A trust region stops when the cost no longer falls, which leaves values good to the square
    root of that; these steps bring them to the rounding of the model itself.
    """
    lower, upper = problem.shape_bounds
    previous_size = np.inf
    dof = max(len(solution.rows) - len(solution.shape), 1)
    for _ in range(POLISH_STEPS):
        norms = np.linalg.norm(solution.jacobian, axis=0)
        if not np.all((norms > 0.0) & np.isfinite(norms)):
            break
        u, singular, v = np.linalg.svd(solution.jacobian / norms, full_matrices=False)
        if len(singular) < len(norms) or singular[-1] <= RANK_LIMIT[solution.method] * singular[0]:
            break
        step = -(v.T @ ((u.T @ solution.rows) / singular)) / norms
        sd = np.sqrt(np.sum((v.T / singular) ** 2, axis=1)) / norms
        size = float(np.max(np.abs(step) / sd))
        shape = solution.shape + step
        if size <= POLISH * np.sqrt(solution.chi2 / dof):
            return replace(solution, finished=True)
        if size > 0.9 * previous_size or np.any((shape <= lower) | (shape >= upper)):
            break
        rows = problem.rows(shape, whitening)
        cost = 0.5 * float(rows @ rows)
        if not cost <= solution.cost * (1.0 + 1e-9):
            break
        previous_size = size
        solution = replace(
            solution,
            shape=shape,
            rows=rows,
            jacobian=row_jacobian(problem, solution.method, shape, whitening),
            cost=cost,
            evaluations=solution.evaluations + 2,
        )
    return solution
