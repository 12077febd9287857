"""Weighted nonlinear least squares with scipy's optimiser and Gauss-Newton polish."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from benchtool.core.choices import Loss
from benchtool.core.error_source import Whitening
from benchtool.core.errors import EstimationError
from benchtool.core.units import Array
from benchtool.fit.jacobian import (
    RANK_LIMIT,
    DerivativeMethod,
    central_differences,
    complex_step,
    select_method,
)
from benchtool.fit.problem import Problem
from benchtool.fit.robust import point_losses

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


def row_jacobian(problem: Problem, method: DerivativeMethod) -> Callable[[Array, Whitening], Array]:
    """Return the function (shape, whitening) -> d rows / d shape (m + q, n_shape)."""
    m, priors, predict = len(problem), problem.priors, problem.predict
    lower, upper = problem.shape_bounds

    def jacobian(shape: Array, whitening: Whitening) -> Array:
        if method == "complex_step":
            data = complex_step(predict, shape, m)
        else:
            data = central_differences(predict, shape, m, lower, upper)
        data = whitening(data)
        return np.concatenate([data, priors.matrix]) if len(priors) else data

    return jacobian


def solve(
    problem: Problem,
    whitening: Whitening,
    start: Array | None = None,
    *,
    loss: Loss = "linear",
    method: DerivativeMethod | None = None,
    max_evaluations: int | None = None,
) -> Solution:
    """Return the minimum of a problem.

    Args:
        start: (n_shape,) initial values near a minimum, tried with Gauss-Newton steps first; None
            means those of the problem.
        loss: of the points, not of priors. Under a robust loss each shared error is a parameter
            with the prior N(0, 1), so that an outlier does not change rows of other points.
        method: method of derivatives; selected by default.
    """
    lower, upper = problem.shape_bounds
    initial = np.clip(problem.start if start is None else start, lower, upper)
    with np.errstate(all="ignore"):
        first = problem.rows(initial, whitening)
        _check_finite(problem, first)
        if method is None:
            method = select_method(problem.predict, initial, len(problem), lower, upper)
        jacobian = row_jacobian(problem, method)
        if start is not None and loss == "linear":
            slopes_0 = jacobian(initial, whitening)
            near = Solution(initial, first, slopes_0, np.inf, False, 2, method)
            near = _polish(problem, whitening, near, jacobian)
            if near.finished:
                return near
        n, draws = len(initial), np.zeros(0 if loss == "linear" else whitening.shared.shape[1])
        independent = whitening if loss == "linear" else whitening.independent
        shared = np.zeros((len(first) + len(draws), len(draws)))
        if len(draws):
            shared[: len(problem)], shared[len(first) :] = whitening.shared, np.eye(len(draws))

        def rows(point: Array) -> Array:
            data = np.concatenate([problem.rows(point[:n], independent), np.zeros(len(draws))])
            return np.asarray(data + shared @ point[n:])

        def slopes(point: Array) -> Array:
            data = np.pad(jacobian(point[:n], independent), ((0, len(draws)), (0, 0)))
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
            max_nfev=max_evaluations or 200 * len(initial),
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
        polished = _polish(problem, whitening, solution, jacobian)
        return replace(polished, finished=solution.finished)


def _polish(
    problem: Problem,
    whitening: Whitening,
    solution: Solution,
    jacobian: Callable[[Array, Whitening], Array],
) -> Solution:
    """Return the solution after Gauss-Newton steps, taken while they shrink and stay in bounds.

    A trust region stops when the cost no longer falls, which leaves values good to the square
    root of that; these steps bring them to the rounding of the model itself.
    """
    lower, upper = problem.shape_bounds
    previous_size = np.inf
    dof = max(len(solution.rows) - len(solution.shape), 1)
    for _ in range(POLISH_STEPS):
        norms = np.linalg.norm(solution.jacobian, axis=0)
        if not np.all(norms > 0.0):
            break
        u, singular, v = np.linalg.svd(solution.jacobian / norms, full_matrices=False)
        if len(singular) < len(norms) or singular[-1] <= RANK_LIMIT[solution.method] * singular[0]:
            break
        step = -(v.T @ ((u.T @ solution.rows) / singular)) / norms
        sd = np.sqrt(np.sum((v.T / singular) ** 2, axis=1)) / norms
        sd *= np.sqrt(solution.chi2 / dof)
        size = float(np.max(np.abs(step) / np.where(sd > 0.0, sd, np.inf)))
        shape = solution.shape + step
        if size < POLISH:
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
            jacobian=jacobian(shape, whitening),
            cost=cost,
            evaluations=solution.evaluations + 2,
        )
    return solution


def _check_finite(problem: Problem, rows: Array) -> None:
    bad = np.flatnonzero(~np.isfinite(rows[: len(problem)]))
    if bad.size:
        raise EstimationError(
            f"the model has no finite prediction for {problem.label(int(bad[0]))} (and "
            f"{bad.size - 1} more) at the initial values; change these or remove the point"
        )
