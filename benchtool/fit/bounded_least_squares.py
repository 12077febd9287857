"""Least squares within bounds, for residuals that are evaluated many sets at once.

Gauss-Newton steps whose bounded linear problem scipy solves exactly (active set), so that a
parameter may come to rest on its bound; several step lengths are tried in one evaluation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from benchtool.core.array_type import Array

Residuals = Callable[[Array], Array]  # residuals(sets (n_sets, n)) -> (n_rows, n_sets)
LENGTHS = (1.0, 0.5, 0.2, 0.05)  # parts of a step that are tried together
STEP = 0.05  # finite difference, in units of the parameters; they are scaled to tolerances

PREDICTED_DECREASE_FACTOR = (
    3.0  # a search may gain so many times what a neighbourhood promises; assumed
)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BoundedRegion:
    """Say where a minimum is looked for.

    Attributes:
        lower, upper: (n,) bounds; equal ones hold a parameter.
        penalty: (n,) weights of a quadratic penalty (p_i x_i)^2, one over a prior's width; 0 for
            none.
    """

    lower: Array
    upper: Array
    penalty: Array

    def clipped(self, at: Array) -> Array:
        """Return the nearest point within the bounds."""
        moved: Array = np.clip(at, self.lower, self.upper)
        return moved

    def cost_of(self, sets: Array) -> Array:
        """Return the penalty of points (..., n)."""
        total: Array = (sets**2) @ self.penalty**2
        return total

    def holds(self, at: Array) -> bool:
        """Whether a point is within the bounds."""
        return bool(np.all(at >= self.lower - 1e-9) and np.all(at <= self.upper + 1e-9))


@dataclass(frozen=True, slots=True, eq=False)
class Linearisation:
    """Hold residuals about a point, without any penalty."""

    at: Array  # (n,) the point
    cost: float  # sum of squares there
    gradient: Array  # (n,) J^T r
    curvature: Array  # (n, n) J^T J

    @classmethod
    def of(cls, at: Array, rows: Array, jacobian: Array) -> Linearisation:
        """Return it from residuals (n_rows,) and their slopes (n_rows, n)."""
        return cls(
            at=np.array(at),
            cost=float(rows @ rows),
            gradient=jacobian.T @ rows,
            curvature=jacobian.T @ jacobian,
        )

    def step(self, region: BoundedRegion) -> tuple[Array, float]:
        """Return the best point of a region, as far as the neighbourhood shows, and its cost."""
        weights = region.penalty**2
        curvature = self.curvature + np.diag(weights)
        gradient = self.gradient + weights * self.at
        factor = _root(curvature)
        target = np.linalg.solve(factor.T, -gradient)
        low, high = region.lower - self.at, region.upper - self.at
        free = high - low > 1e-9
        move = np.clip(np.zeros(len(self.at)), low, high)
        if free.any():
            fixed = factor[:, ~free] @ move[~free]
            found = lsq_linear(
                factor[:, free], target - fixed, (low[free], high[free]), method="bvls", tol=1e-10
            )
            move[free] = np.clip(found.x, low[free], high[free])
        gained = 2.0 * gradient @ move + move @ curvature @ move
        return self.at + move, float(self.cost + region.cost_of(self.at) + gained)


@dataclass(frozen=True, slots=True, eq=False)
class MinimizationResult:
    """Hold where a bounded search ended."""

    at: Array  # (n,) the point
    cost: float  # sum of squares there, penalties included
    converged: bool  # whether the last step gained nothing that matters


def _root(curvature: Array) -> Array:
    """Return R with R^T R = curvature, made safe where data say nothing."""
    ridge = 1e-9 * np.trace(curvature) / len(curvature) + 1e-12
    root: Array = np.linalg.cholesky(curvature + ridge * np.eye(len(curvature))).T
    return root


class BoundedSearch:
    """Search minima of one sum of squares in many different regions.

    Args:
        linearised: neighbourhood of a point (n,).
    """

    def __init__(
        self, costs: Callable[[Array], Array], linearised: Callable[[Array], Linearisation]
    ) -> None:
        self._costs = costs
        self.linearised = linearised

    @classmethod
    def of(cls, residuals: Residuals, limits: tuple[Array, Array]) -> BoundedSearch:
        """Return the search for residuals, many sets at once.

        Args:
            limits: lower and upper (n,) that finite differences may not leave.
        """

        def costs(sets: Array) -> Array:
            rows = residuals(sets)
            return np.asarray(np.einsum("ij,ij->j", rows, rows), float)

        return cls(costs, lambda at: Linearisation.of(at, *slopes(residuals, at, limits[1])))

    def minimum(
        self,
        start: Array,
        region: BoundedRegion,
        *,
        known: Linearisation | None = None,
        most_steps: int = 12,
        enough: float = 0.1,
        above: float = np.inf,
    ) -> MinimizationResult:
        """Return the minimum of a region that is reached from a point.

        Args:
            start: (n,) where to begin; moved into the region.
            region: bounds and penalties.
            known: a neighbourhood to take the first step from; its point may lie outside.
            most_steps: linearisations to make at most.
            enough: stop when a step gains less than this in the sum of squares.
            above: give up once a neighbourhood promises no cost below this, nor would with
                `PREDICTED_DECREASE_FACTOR` times the gain.
        """
        here = known if known is not None else self.linearised(region.clipped(start))
        best = MinimizationResult(here.at, here.cost + float(region.cost_of(here.at)), False)
        if not region.holds(here.at):
            best = MinimizationResult(here.at, np.inf, False)
        for step in range(1, most_steps + 1):
            aim, promised = here.step(region)
            if best.cost - PREDICTED_DECREASE_FACTOR * (best.cost - promised) > above:
                return best
            inside = region.clipped(here.at)
            sets = np.array([inside + part * (aim - inside) for part in LENGTHS])
            costs = self._costs(sets)
            costs = np.where(np.isfinite(costs), costs, np.inf) + region.cost_of(sets)
            winner = int(np.argmin(costs))
            gain = best.cost - float(costs[winner])
            if gain > 0.0:
                best = MinimizationResult(sets[winner], float(costs[winner]), False)
            if not gain > enough:
                return MinimizationResult(best.at, best.cost, bool(np.isfinite(best.cost)))
            if step < most_steps:
                here = self.linearised(best.at)
        return best


def slopes(residuals: Residuals, at: Array, upper: Array) -> tuple[Array, Array]:
    """Return residuals (n_rows,) and their slopes (n_rows, n) at a point, no step above `upper`."""
    steps = np.where(at + STEP <= upper, STEP, -STEP)
    rows = residuals(np.vstack([at, at + np.diag(steps)]))
    jacobian = (rows[:, 1:] - rows[:, :1]) / steps
    return rows[:, 0], np.where(np.isfinite(jacobian), jacobian, 0.0)  # no value, no slope
