"""Covariance of residuals: independent noise plus discrepancies as low-rank additions.

For rows divided by their noise the covariance is V = 1 + C C^T. By Woodbury's identity a search
needs only products of residuals, their slopes and C. A change of discrepancies needs matrices of a
hundred rows, not a model evaluation.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.explain.engine.bounded_least_squares import (
    BoundedSearch,
    Linearisation,
    finite_differences,
)
from benchtool.explain.engine.evidence import Evidence

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
        # Over the noise, by discrepancy or law; single precision to save memory.
        self.all_columns: dict[str, NDArray[np.float32]] = {}
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
        rows, jacobian = finite_differences(self._evidence.residuals, self.null_start, self._upper)
        sigma, share = np.ones(len(rows)), np.ones(len(rows))
        if not self.discrepancies:
            return sigma, share
        jacobian *= PRIOR_WIDTH_FACTOR
        wide = np.hstack([*(part.columns for part in self.discrepancies.values()), jacobian])
        wide[:, : -len(jacobian.T)] *= AMPLITUDES[1]
        del jacobian  # the largest array of a recording of half an hour
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
        """Add columns (n_rows, r) over the noise; clear cached products."""
        single = columns.astype(np.float32)
        columns = single.astype(float)
        cross_terms = self._project(columns)
        self._inner = np.block([[self._inner, cross_terms], [cross_terms.T, columns.T @ columns]])
        self.all_columns[name] = single
        self._kernels.clear()
        self._products.clear()

    def _project(self, rows: Array) -> Array:
        """Return products of all columns with rows (n_rows, n)."""
        products = [columns.T @ rows for columns in self.all_columns.values()]
        return np.vstack([np.empty((0, rows.shape[1])), *products])

    @property
    def n_rows(self) -> int:
        """Number of residuals."""
        return len(self.noise)

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
        self._noise  # noqa: B018  # computes the columns
        parts = [
            factor * self.all_columns[name] for name, factor in self.factors(amplitudes).items()
        ]
        return np.hstack([np.empty((self.n_rows, 0)), *parts])

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
                last = first + columns.shape[1]
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
        key = at.tobytes()
        noise = self.noise
        if key not in self._products:
            rows, jacobian = finite_differences(self._evidence.residuals, at, self._upper)
            both = np.column_stack([rows, jacobian]) / noise[:, None]
            stacked = self._project(both)
            self._products[key] = both.T @ both, stacked
        residual, columns = self._products[key]
        indices, half, _ = self.kernel(amplitudes)
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

    def weighted_residuals(self, at: Array, amplitudes: Mapping[str, float]) -> Array:
        """Return residuals at a point (n_rows,), weighted by the inverse covariance: V^-1 r."""
        return solve_covariance(self.columns(amplitudes), self.rows(at)[:, 0]) / self.noise


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
