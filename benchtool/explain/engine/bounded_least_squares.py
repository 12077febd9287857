"""Bounded least squares for residuals that are evaluated for many parameter sets at once.

Gauss-Newton; scipy solves the bounded linear problem of each step exactly (active set), so a
parameter can end at its bound. Several step lengths are tried in one evaluation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky
from scipy.optimize import lsq_linear

from benchtool.core.units import Array

Residuals = Callable[[Array], Array]  # residuals(sets (n_sets, n)) -> (n_rows, n_sets)
STEP_LENGTHS = (1.0, 0.5, 0.2, 0.05)  # fractions of a Gauss-Newton step, evaluated together
STEP = 0.05  # finite difference, in units of the parameters; they are scaled to tolerances

PREDICTED_DECREASE_FACTOR = 3.0  # largest gain over the gain of the linear model; assumed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BoundedRegion:
    """Bounds and penalties of a minimization."""

    lower: Array  # (n,) equal bounds fix a parameter
    upper: Array  # (n,)
    penalty: Array  # (n,) p of a quadratic penalty (p_i x_i)^2: 1 / prior width; 0 for none

    def clip(self, values: Array) -> Array:
        """Return the nearest point within the bounds."""
        clipped_values: Array = np.clip(values, self.lower, self.upper)
        return clipped_values

    def penalty_cost(self, sets: Array) -> Array:
        """Return the penalty of points (..., n)."""
        total: Array = (sets**2) @ self.penalty**2
        return total

    def contains(self, values: Array) -> bool:
        """Return True if a point is within the bounds."""
        return bool(np.all(values >= self.lower - 1e-9) and np.all(values <= self.upper + 1e-9))


@dataclass(frozen=True, slots=True, eq=False)
class Linearisation:
    """Linear model of residuals at a point, without penalties."""

    point: Array  # (n,) the point
    cost: float  # sum of squares there
    gradient: Array  # (n,) J^T r
    curvature: Array  # (n, n) J^T J

    def step(self, region: BoundedRegion) -> tuple[Array, float]:
        """Return the minimum of the linear model within a region, and its cost."""
        weights = region.penalty**2
        curvature = self.curvature + np.diag(weights)
        gradient = self.gradient + weights * self.point
        factor = _root(curvature)
        target = np.linalg.solve(factor.T, -gradient)
        low, high = region.lower - self.point, region.upper - self.point
        free = high - low > 1e-9
        move = np.clip(np.zeros(len(self.point)), low, high)
        if free.any():
            fixed = factor[:, ~free] @ move[~free]
            solution = lsq_linear(
                factor[:, free], target - fixed, (low[free], high[free]), method="bvls", tol=1e-10
            )
            move[free] = np.clip(solution.x, low[free], high[free])
        change = 2.0 * gradient @ move + move @ curvature @ move
        return self.point + move, float(self.cost + region.penalty_cost(self.point) + change)


@dataclass(frozen=True, slots=True, eq=False)
class MinimizationResult:
    """Result of a bounded search."""

    values: Array  # (n,) the point
    cost: float  # sum of squares there, penalties included
    converged: bool  # the last step gained less than the minimum gain


def _root(curvature: Array) -> Array:
    """Return R with R^T R = curvature plus a small ridge for undetermined parameters."""
    ridge = 1e-9 * np.trace(curvature) / len(curvature) + 1e-12
    root: Array = np.linalg.cholesky(curvature + ridge * np.eye(len(curvature))).T
    return root


@dataclass(frozen=True, slots=True, eq=False)
class BoundedSearch:
    """Minimizer of one sum of squares in many regions."""

    costs: Callable[[Array], Array]  # sums of squares (n_sets,) of parameter sets (n_sets, n)
    linearise: Callable[[Array], Linearisation]  # at a point (n,)

    def minimize(
        self,
        start: Array,
        region: BoundedRegion,
        *,
        linearisation: Linearisation | None = None,
        max_steps: int = 12,
        min_gain: float = 0.1,
        max_cost: float = np.inf,
    ) -> MinimizationResult:
        """Return the local minimum of a region for a start point (n,), clipped to the region.

        Args:
            linearisation: of the first step; its point may lie outside the region.
            min_gain: stop when a step reduces the sum of squares by less than this.
            max_cost: stop when the predicted cost, with `PREDICTED_DECREASE_FACTOR` times the
                predicted gain, stays above this.
        """
        local = linearisation if linearisation is not None else self.linearise(region.clip(start))
        penalty_cost = float(region.penalty_cost(local.point))
        best = MinimizationResult(local.point, local.cost + penalty_cost, False)
        if not region.contains(local.point):
            best = MinimizationResult(local.point, np.inf, False)
        for step in range(1, max_steps + 1):
            target, predicted_cost = local.step(region)
            if best.cost - PREDICTED_DECREASE_FACTOR * (best.cost - predicted_cost) > max_cost:
                return best
            inside = region.clip(local.point)
            sets = np.array([inside + length * (target - inside) for length in STEP_LENGTHS])
            costs = self.costs(sets)
            costs = np.where(np.isfinite(costs), costs, np.inf) + region.penalty_cost(sets)
            best_index = int(np.argmin(costs))
            gain = best.cost - float(costs[best_index])
            if gain > 0.0:
                best = MinimizationResult(sets[best_index], float(costs[best_index]), False)
            if not gain > min_gain:
                return MinimizationResult(best.values, best.cost, bool(np.isfinite(best.cost)))
            if step < max_steps:
                local = self.linearise(best.values)
        return best


def finite_differences(residuals: Residuals, at: Array, upper: Array) -> tuple[Array, Array]:
    """Return residuals (n_rows,) and their Jacobian (n_rows, n); no step exceeds `upper`."""
    steps = np.where(at + STEP <= upper, STEP, -STEP)
    rows = residuals(np.vstack([at, at + np.diag(steps)]))
    jacobian = (rows[:, 1:] - rows[:, :1]) / steps
    return rows[:, 0], np.where(np.isfinite(jacobian), jacobian, 0.0)  # not finite: slope 0


UNDETERMINED_HINT = 25.0  # mean ratio below which two effects form a class: a draw may be 10


def evidence_against(matrix: Array, sizes: Array, low: Array, high: Array) -> float:
    """Return twice the expected log-likelihood ratio of the truth to the best rival model.

    Second-order approximation. Rival effects are free within the bounds; all other parameters,
    true effects included, stay within tolerance. Models with a small ratio are indistinguishable.

    Args:
        matrix: (k, k) Fisher information, each parameter in units of its tolerance.
        sizes: (k,) true values, in tolerances past neutral.
        low: (k,) lower bounds of the rival model, in tolerances past neutral.
        high: (k,) upper bounds.
    """
    diagonal = np.diag(matrix)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    root = cholesky(scale[:, None] * matrix * scale + 1e-10 * np.eye(len(sizes)))
    lowest, highest = (low - sizes) / scale, (high - sizes) / scale
    # lsq_linear needs bounds that differ.
    highest = np.maximum(highest, lowest + 1e-9)
    best = lsq_linear(root, np.zeros(len(sizes)), bounds=(lowest, highest), method="bvls")
    return 2.0 * float(best.cost)
