"""One weighted nonlinear least-squares solution: the only caller of scipy's optimiser."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from benchtool.core.array_type import Array
from benchtool.core.error_source import Whitening
from benchtool.core.errors import EstimationError
from benchtool.fit.jacobian import RANK_LIMIT, Way, central_differences, complex_step, select_method
from benchtool.fit.problem import Problem
from benchtool.fit.robust import Loss, point_losses

TOLERANCE = 1e-10  # relative change of cost and step below which the polish takes over
POLISH = 1e-8  # part of a standard deviation below which a Gauss-Newton step does not matter
POLISH_STEPS = 12  # maximum; a step that does not shrink ends them: only rounding is left


@dataclass(frozen=True, slots=True, eq=False)
class Solution:
    """Hold one minimum.

    Under a robust loss rows are residuals in the points' own errors, after the r draws of all
    shared errors; the draws follow, as rows and as parameters.
    """

    shape: Array  # (n_shape,) values
    rows: Array  # (m + q [+ r],) whitened residuals there
    jacobian: Array  # (m + q [+ r], n_shape [+ r]) of the rows, plain (no loss in it)
    cost: float  # half the sum of squares, after the loss
    finished: bool  # whether a tolerance was met
    evaluations: int  # of the prediction, its derivatives counted as one each
    way: Way  # how derivatives were taken

    @property
    def chi2(self) -> float:
        """Sum of squared rows."""
        return float(self.rows @ self.rows)

    def points_dof(self, m: int) -> float:
        """Degrees of freedom that the rows of the m points have: m less their leverages."""
        return m - float(np.sum(np.linalg.qr(self.jacobian)[0][:m] ** 2))


def row_jacobian(problem: Problem, way: Way) -> Callable[[Array, Whitening], Array]:
    """Return the function (shape, whitening) -> d rows / d shape (m + q, n_shape)."""
    m, priors, predict = len(problem), problem.priors, problem.predict
    lower, upper = problem.shape_bounds

    def jacobian(shape: Array, whitening: Whitening) -> Array:
        if way == "complex_step":
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
    way: Way | None = None,
    max_evaluations: int | None = None,
) -> Solution:
    """Return the minimum reached from `start` (n_shape,), by default the problem's own.

    Args:
        start: where to begin; Gauss-Newton steps are tried first from a minimum nearby.
        loss: how far rows of points count less; rows of priors always count in full. Under a
            robust one each shared draw is a parameter with the prior N(0, 1), so that one point
            far out does not move the rows of those that share a draw with it.
        way: how to take derivatives; found out when left out.
    """
    lower, upper = problem.shape_bounds
    begin = np.clip(problem.start if start is None else start, lower, upper)
    with np.errstate(all="ignore"):
        first = problem.rows(begin, whitening)
        _refuse_unusable(problem, first)
        if way is None:
            way = select_method(problem.predict, begin, len(problem), lower, upper)
        jacobian = row_jacobian(problem, way)
        if start is not None and loss == "linear":
            near = Solution(begin, first, jacobian(begin, whitening), np.inf, False, 2, way)
            near = _polished(problem, whitening, near, jacobian)
            if near.finished:
                return near
        n, draws = len(begin), np.zeros(0 if loss == "linear" else whitening.shared.shape[1])
        own = whitening if loss == "linear" else whitening.own
        lift = np.zeros((len(first) + len(draws), len(draws)))
        if len(draws):
            lift[: len(problem)], lift[len(first) :] = whitening.shared, np.eye(len(draws))

        def rows(point: Array) -> Array:
            data = np.concatenate([problem.rows(point[:n], own), np.zeros(len(draws))])
            return np.asarray(data + lift @ point[n:])

        def slopes(point: Array) -> Array:
            data = np.pad(jacobian(point[:n], own), ((0, len(draws)), (0, 0)))
            return np.concatenate([data, lift], axis=1)

        counted: Any = loss if loss == "linear" else point_losses(loss, len(problem))
        found: Any = least_squares(
            rows,
            np.concatenate([begin, draws]),
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
            loss=counted,
            max_nfev=max_evaluations or 200 * len(begin),
        )
        solution = Solution(
            shape=np.asarray(found.x[:n], float),
            rows=np.asarray(found.fun, float),
            jacobian=np.asarray(found.jac) if loss == "linear" else slopes(found.x),
            cost=float(found.cost),
            finished=found.status > 0,
            evaluations=int(found.nfev) + int(found.njev),
            way=way,
        )
        if loss != "linear":
            return solution
        polished = _polished(problem, whitening, solution, jacobian)
        return replace(polished, finished=solution.finished)


def _polished(
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
    before = np.inf
    left = max(len(solution.rows) - len(solution.shape), 1)
    for _ in range(POLISH_STEPS):
        norms = np.linalg.norm(solution.jacobian, axis=0)
        if not np.all(norms > 0.0):
            break
        u, singular, v = np.linalg.svd(solution.jacobian / norms, full_matrices=False)
        if len(singular) < len(norms) or singular[-1] <= RANK_LIMIT[solution.way] * singular[0]:
            break
        step = -(v.T @ ((u.T @ solution.rows) / singular)) / norms
        sd = np.sqrt(np.sum((v.T / singular) ** 2, axis=1)) / norms
        sd *= np.sqrt(solution.chi2 / left)
        size = float(np.max(np.abs(step) / np.where(sd > 0.0, sd, np.inf)))
        shape = solution.shape + step
        if size < POLISH:
            return replace(solution, finished=True)
        if size > 0.9 * before or np.any((shape <= lower) | (shape >= upper)):
            break
        rows = problem.rows(shape, whitening)
        cost = 0.5 * float(rows @ rows)
        if not cost <= solution.cost * (1.0 + 1e-9):
            break
        before = size
        solution = replace(
            solution,
            shape=shape,
            rows=rows,
            jacobian=jacobian(shape, whitening),
            cost=cost,
            evaluations=solution.evaluations + 2,
        )
    return solution


def _refuse_unusable(problem: Problem, rows: Array) -> None:
    bad = np.flatnonzero(~np.isfinite(rows[: len(problem)]))
    if bad.size:
        raise EstimationError(
            f"the model gives no finite prediction for {problem.label(int(bad[0]))} (and "
            f"{bad.size - 1} more) at the starting values; start elsewhere or leave it out"
        )
