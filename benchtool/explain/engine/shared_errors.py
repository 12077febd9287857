"""Residuals whose errors are shared: noise of each row, and discrepancies as low-rank additions.

With V = 1 + C C^T over the noise everything that a search asks for follows from products of
residuals, their slopes and the columns C (Woodbury's identity), so that another hypothesis about
discrepancies costs matrices of a hundred rows instead of a run of the model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.explain.engine.evidence import Evidence
from benchtool.fit.bounded_least_squares import BoundedSearch, Linearisation, slopes

PRIOR_WIDTH_FACTOR = (
    5.0  # standard deviation of an effect that breaks its tolerance, in tolerances; assumed
)
AMPLITUDES = (3.0, 10.0, 30.0)  # sizes of a discrepancy beyond tolerance, in its sd; assumed
STATED = 20.0  # rows that the stated noise counts for: known to a sixth or so; assumed
BATCH_ROWS = 1_000_000  # numbers of a block of rows


@dataclass(frozen=True, slots=True, eq=False)
class _Products:
    """Hold products of residuals, their slopes and the columns of discrepancies at a point."""

    own: Array  # (1 + n_parameters, same) of residuals and slopes with each other
    shared: Array  # (n_columns, 1 + n_parameters) of columns with them


_Kernel = tuple[NDArray[np.intp], Array, float]


class SharedErrors:
    """Hold evidence with the errors that its rows share."""

    def __init__(self, evidence: Evidence) -> None:
        self._evidence = evidence
        self._upper = np.array([parameter.most for parameter in evidence.parameters])
        self.discrepancies = {one.name: one for one in evidence.discrepancies()}
        self._products: dict[bytes, _Products] = {}
        # Over the noise, by discrepancy or law: the most of what is held, so in single precision.
        self._columns: dict[str, NDArray[np.float32]] = {}
        self._inner = np.empty((0, 0))  # products of the columns with each other
        self._kernels: dict[tuple[tuple[str, float], ...], _Kernel] = {}

    @property
    def noise(self) -> Array:
        """How large the noise of each row is over the stated one (n_rows,), 1 at least."""
        return self._noise[0]

    @property
    def variance(self) -> Array:
        """Variance of each row's noise over `noise` (n_rows,): below 1 where too much is stated."""
        return self._noise[1]

    @cached_property
    def _noise(self) -> tuple[Array, Array]:
        """Noise and variance, by stage, from what no discrepancy, however large, takes up."""
        rows, jacobian = slopes(self._evidence.residuals, self.null_start, self._upper)
        sigma, share = np.ones(len(rows)), np.ones(len(rows))
        if not self.discrepancies:
            return sigma, share
        jacobian *= PRIOR_WIDTH_FACTOR
        wide = np.hstack([*(one.columns for one in self.discrepancies.values()), jacobian])
        wide[:, : -len(jacobian.T)] *= AMPLITUDES[1]
        del jacobian  # of half an hour they are the most that is held at once
        left, gain = solve_covariance(wide, rows), _own_shares(wide)
        del wide
        for mask in self._evidence.groups().stages.values():
            counted = float(np.sum(gain[mask]))
            variance = (STATED + float(np.sum(left[mask] * rows[mask]))) / (STATED + counted)
            sigma[mask] = np.sqrt(max(1.0, variance))
            share[mask] = min(1.0, variance)
        for name, one in self.discrepancies.items():
            self.add(name, one.columns / sigma[:, None])
        return sigma, share

    def add(self, name: str, columns: Array) -> None:
        """Add columns (n_rows, r) over the noise; products at points known so far go without."""
        single = columns.astype(np.float32)
        columns = single.astype(float)
        cross = [known.T @ columns for known in self._columns.values()]
        beside = np.vstack(cross) if cross else np.empty((0, columns.shape[1]))
        self._inner = np.block([[self._inner, beside], [beside.T, columns.T @ columns]])
        self._columns[name] = single
        self._kernels.clear()
        self._products.clear()

    @property
    def n_rows(self) -> int:
        """How many residuals there are."""
        return len(self.noise)

    @cached_property
    def null_start(self) -> Array:
        """Where a search begins (n_parameters,)."""
        return np.array([one.first for one in self._evidence.parameters])

    def factors(self, widened: Mapping[str, float]) -> dict[str, float]:
        """Return how many times its usual size each discrepancy and law is that is there."""
        always = {name: 1.0 for name, one in self.discrepancies.items() if one.always}
        return {**always, **widened}

    def columns(self, widened: Mapping[str, float]) -> Array:
        """Return the columns (n_rows, r) of what is there, as large as it is, over the noise."""
        self._noise  # noqa: B018  # columns are known from then on
        parts = [factor * self._columns[name] for name, factor in self.factors(widened).items()]
        return np.hstack([np.empty((self.n_rows, 0)), *parts])

    def rows(self, sets: Array) -> Array:
        """Return residuals over the noise (n_rows, n_sets)."""
        found: Array = self._evidence.residuals(np.atleast_2d(sets)) / self.noise[:, None]
        return found

    def _shared(self, widened: Mapping[str, float]) -> _Kernel:
        """Return which columns are there and as large, the inverse of their kernel, its log det."""
        key = tuple(sorted(widened.items()))
        if key not in self._kernels:
            factors, first = self.factors(widened), 0
            places, sizes = list[int](), list[float]()
            for name, columns in self._columns.items():
                last = first + columns.shape[1]
                if name in factors:
                    places += range(first, last)
                    sizes += [factors[name]] * (last - first)
                first = last
            size = np.array(sizes)
            inner = self._inner[np.ix_(places, places)]
            kernel = np.eye(len(size)) + size[:, None] * inner * size
            root = np.linalg.cholesky(kernel)
            half = np.linalg.solve(root, np.diag(size))
            self._kernels[key] = np.array(places, np.intp), half, float(np.log(np.diag(root)).sum())
        return self._kernels[key]

    def near(self, at: Array, widened: Mapping[str, float]) -> Linearisation:
        """Return the neighbourhood of a point; the same one is worked out once."""
        key = at.tobytes()
        noise = self.noise
        if key not in self._products:
            rows, jacobian = slopes(self._evidence.residuals, at, self._upper)
            both = np.column_stack([rows, jacobian]) / noise[:, None]
            shared = [columns.T @ both for columns in self._columns.values()]
            self._products[key] = _Products(
                both.T @ both, np.vstack(shared) if shared else np.empty((0, both.shape[1]))
            )
        known = self._products[key]
        places, half, _ = self._shared(widened)
        taken = half @ known.shared[places]
        left = known.own - taken.T @ taken
        return Linearisation(
            at=np.array(at), cost=float(left[0, 0]), gradient=left[1:, 0], curvature=left[1:, 1:]
        )

    def search(self, widened: Mapping[str, float]) -> BoundedSearch:
        def costs(sets: Array) -> Array:
            rows = self.rows(sets)
            places, half, _ = self._shared(widened)
            every = list(self._columns.values())
            shared = np.vstack([one.T @ rows for one in every]) if every else rows[:0]
            taken = half @ shared[places]
            return np.asarray(np.sum(rows**2, axis=0) - np.sum(taken**2, axis=0), float)

        return BoundedSearch(costs, lambda at: self.near(at, widened))

    def left(self, at: Array, widened: Mapping[str, float]) -> Array:
        """Return what is left at a point (n_rows,), over its covariance: V^-1 r."""
        return solve_covariance(self.columns(widened), self.rows(at)[:, 0]) / self.noise

    def law(self, name: str) -> Array:
        """Return how an effect's own law may be off (n_rows, r), over the noise."""
        return self._columns[name].astype(float)

    @property
    def n_columns(self) -> int:
        """How many discrepancies and laws there are."""
        return len(self._columns)

    def log_root(self, widened: Mapping[str, float]) -> float:
        """Return half of the log determinant of the covariance over the noise."""
        return self._shared(widened)[2]


def _own_shares(columns: Array) -> Array:
    """Return the diagonal (n_rows,) of V^-1 for V = 1 + columns columns^T."""
    inner = np.eye(columns.shape[1]) + columns.T @ columns
    half = np.linalg.inv(np.linalg.cholesky(inner)).T
    blocks = np.array_split(columns, 1 + columns.size // BATCH_ROWS)
    taken = np.concatenate([np.sum((block @ half) ** 2, axis=1) for block in blocks])
    return np.asarray(1.0 - taken, float)


def solve_covariance(columns: Array, rows: Array) -> Array:
    """Return V^-1 rows (n_rows, ...) for V = 1 + columns columns^T."""
    inner = np.eye(columns.shape[1]) + columns.T @ columns
    found: Array = rows - columns @ np.linalg.solve(inner, columns.T @ rows)
    return found
