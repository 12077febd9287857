"""Bounded least squares for residuals that are evaluated for many parameter sets at once.

Gauss-Newton; scipy solves the bounded linear problem of each step exactly (active set), so a
parameter can end at its bound. Several step lengths are tried in one evaluation.

The covariance of residuals has independent noise and discrepancies as low-rank additions: for rows
divided by their noise V = 1 + C C^T. By Woodbury's identity a search needs only products of
residuals, their slopes and C. A change of discrepancies needs matrices of a hundred rows, not a
model evaluation.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky
from scipy.optimize import lsq_linear

from benchtool.core.units import Array
from benchtool.explain.engine.evidence import Evidence

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
        if np.any(np.abs(region.clip(local.point) - local.point) > 1e-9):
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


def finite_differences(residuals: Residuals, at: Array, upper: Array) -> Array:
    """Return residuals with their Jacobian beside them (n_rows, 1 + n); no step exceeds `upper`."""
    steps = np.where(at + STEP <= upper, STEP, -STEP)
    rows = residuals(np.vstack([at, at + np.diag(steps)]))  # overwritten
    jacobian = rows[:, 1:]
    jacobian -= rows[:, :1]
    jacobian /= steps
    is_finite = np.isfinite(jacobian)
    if not is_finite.all():
        jacobian[~is_finite] = 0.0
    return rows


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


PRIOR_WIDTH_FACTOR = 5.0  # prior sd of an effect beyond tolerance, in tolerances; assumed
AMPLITUDES = (3.0, 10.0, 30.0)  # sizes of a discrepancy beyond tolerance, in its sd; assumed
STATED_NOISE_ROWS = 20.0  # prior weight of the stated noise (known to about 1/6); assumed
BATCH_ROWS = 1_000_000  # values in a block of rows

# Products at a point: of residuals and slopes (1 + n_parameters, same), and of columns with them
_Products = tuple[Array, Array]
# Indices of active columns, inverse root of their kernel, half of its log determinant
_Kernel = tuple[NDArray[np.intp], Array, float]


class SharedErrors:
    """Evidence with the covariance of its rows."""

    def __init__(self, evidence: Evidence) -> None:
        self._evidence = evidence
        self._upper = np.array([parameter.most for parameter in evidence.parameters])
        self.discrepancies = {part.name: part for part in evidence.discrepancies()}
        self._products: dict[bytes, _Products] = {}
        self.all_columns: dict[str, Array] = {}  # (r, n_rows) over the noise, by discrepancy or law
        self._inner = np.empty((0, 0))  # products of all columns
        self._kernels: dict[tuple[tuple[str, float], ...], _Kernel] = {}

    @property
    def noise(self) -> Array:
        """Noise of each row over the stated noise (n_rows,), at least 1."""
        return self._noise[0]

    @property
    def variance(self) -> Array:
        """Variance of each row's noise over `noise` (n_rows,); below 1 if that is too large."""
        return self._noise[1]

    @cached_property
    def _noise(self) -> tuple[Array, Array]:
        """Noise and variance by stage, from residuals not explained by large discrepancies."""
        table = finite_differences(self._evidence.residuals, self.null_start, self._upper)
        rows, jacobian = table[:, 0], table[:, 1:]
        sigma, share = np.ones(len(rows)), np.ones(len(rows))
        if not self.discrepancies:
            return sigma, share
        jacobian *= PRIOR_WIDTH_FACTOR
        wide = np.hstack([*(part.columns for part in self.discrepancies.values()), jacobian])
        wide[:, : -len(jacobian.T)] *= AMPLITUDES[1]
        solved, remaining = solve_covariance(wide, rows), _own_shares(wide)
        del wide
        for mask in self._evidence.groups().stages.values():
            degrees = float(np.sum(remaining[mask]))
            variance = STATED_NOISE_ROWS + float(np.sum(solved[mask] * rows[mask]))
            variance /= STATED_NOISE_ROWS + degrees
            sigma[mask] = np.sqrt(max(1.0, variance))
            share[mask] = min(1.0, variance)
        for name, part in self.discrepancies.items():
            self.add(name, part.columns / sigma[:, None])
        return sigma, share

    def add(self, name: str, columns: Array) -> None:
        """Add columns (n_rows, r) over the noise."""
        columns = columns.astype(np.float32).astype(float)
        cross_terms = self._project(columns)
        self._inner = np.block([[self._inner, cross_terms], [cross_terms.T, columns.T @ columns]])
        self.all_columns[name] = np.ascontiguousarray(columns.T)
        self._kernels.clear()

    def _project(self, rows: Array) -> Array:
        """Return products of all columns with rows (n_rows, n)."""
        products = [columns @ rows for columns in self.all_columns.values()]
        return np.vstack([np.empty((0, rows.shape[1])), *products])

    @cached_property
    def null_start(self) -> Array:
        """Initial values of a search (n_parameters,)."""
        return np.array([parameter.first for parameter in self._evidence.parameters])

    def factors(self, amplitudes: Mapping[str, float]) -> dict[str, float]:
        """Return the amplitude of each active discrepancy and law, in standard amplitudes."""
        always = {name: 1.0 for name, part in self.discrepancies.items() if part.always}
        return {**always, **amplitudes}

    def columns(self, amplitudes: Mapping[str, float]) -> Array:
        """Return the active columns (n_rows, r), scaled by amplitude, over the noise."""
        factors, n_rows = self.factors(amplitudes), len(self.noise)  # computes the columns
        parts = [factors[name] * self.all_columns[name].T.astype(np.float32) for name in factors]
        return np.hstack([np.empty((n_rows, 0)), *parts])

    def rows(self, sets: Array) -> Array:
        """Return residuals over the noise (n_rows, n_sets)."""
        result: Array = self._evidence.residuals(np.atleast_2d(sets)) / self.noise[:, None]
        return result

    def kernel(self, amplitudes: Mapping[str, float]) -> _Kernel:
        """Return the covariance of active columns, cached."""
        key = tuple(sorted(amplitudes.items()))
        if key not in self._kernels:
            factors, first = self.factors(amplitudes), 0
            indices, sizes = list[int](), list[float]()
            for name, columns in self.all_columns.items():
                last = first + len(columns)
                if name in factors:
                    indices += range(first, last)
                    sizes += [factors[name]] * (last - first)
                first = last
            size = np.array(sizes)
            inner = self._inner[np.ix_(indices, indices)]
            kernel = np.eye(len(size)) + size[:, None] * inner * size
            root = np.linalg.cholesky(kernel)
            half = np.linalg.solve(root, np.diag(size))
            log_root = float(np.log(np.diag(root)).sum())
            self._kernels[key] = (np.array(indices, np.intp), half, log_root)
        return self._kernels[key]

    def linearise(self, at: Array, amplitudes: Mapping[str, float]) -> Linearisation:
        """Return the linearisation at a point, cached."""
        key, noise = at.tobytes(), self.noise
        indices, half, _ = self.kernel(amplitudes)
        residual, columns = self._products.get(key, (np.empty((0, 0)), np.empty((0, 0))))
        if not len(residual) or indices.max(initial=-1) >= len(columns):  # new, or new columns
            both = finite_differences(self._evidence.residuals, at, self._upper)
            both /= noise[:, None]
            residual, columns = self._products[key] = both.T @ both, self._project(both)
        explained = half @ columns[indices]
        reduced = residual - explained.T @ explained
        cost, gradient, curvature = float(reduced[0, 0]), reduced[1:, 0], reduced[1:, 1:]
        return Linearisation(np.array(at), cost, gradient, curvature)

    def search(self, amplitudes: Mapping[str, float]) -> BoundedSearch:
        def costs(sets: Array) -> Array:
            rows = self.rows(sets)
            indices, half, _ = self.kernel(amplitudes)
            explained = half @ self._project(rows)[indices]
            return np.asarray(np.sum(rows**2, axis=0) - np.sum(explained**2, axis=0), float)

        return BoundedSearch(costs, lambda at: self.linearise(at, amplitudes))


def _own_shares(columns: Array) -> Array:
    """Return the diagonal (n_rows,) of V^-1 for V = 1 + columns columns^T."""
    inner = np.eye(columns.shape[1]) + columns.T @ columns
    half = np.linalg.inv(np.linalg.cholesky(inner)).T
    blocks = np.array_split(columns, 1 + columns.size // BATCH_ROWS)
    explained = np.concatenate([np.sum((block @ half) ** 2, axis=1) for block in blocks])
    return np.asarray(1.0 - explained, float)


def solve_covariance(columns: Array, rows: Array) -> Array:
    """Return V^-1 rows (n_rows, ...) for V = 1 + columns columns^T."""
    inner = np.eye(columns.shape[1]) + columns.T @ columns
    result: Array = rows - columns @ np.linalg.solve(inner, columns.T @ rows)
    return result
