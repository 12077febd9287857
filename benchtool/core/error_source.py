"""Error sources shared by observations, and whitening of residuals with the full covariance."""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.choices import Distribution, EvaluationType
from benchtool.core.units import Array


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ErrorSource:
    """Error source shared by several observations (fully correlated draws).

    It adds `columns @ columns.T` to the covariance of the observations. Reference points of ratios
    have one column each, position errors one per plate position, a scale error one in all, and
    zero drift the columns of a square root of its covariance.

    Attributes:
        sd: standard deviation of one draw, in `unit`; typical value if draws differ.
        dof: degrees of freedom of `sd`.
        columns: (m, r) change of each observation by one standard deviation of each of r
            independent draws, in the unit of the observations.
        scaled: whether `noise.scale` multiplies it, as it does standard errors of points; true for
            scatter of the same kind, such as that of reference points.
        origin: source of the value, for the uncertainty budget.
        parameter: noise parameter that replaces `sd` if it is free; else empty.
        scatter: name of the scatter from which several sources estimate `sd`; else empty.
    """

    name: str
    kind: EvaluationType
    unit: str
    sd: float
    columns: Array
    distribution: Distribution = "normal"
    dof: float = np.inf
    scaled: bool = False
    origin: str = ""
    parameter: str = ""
    scatter: str = ""

    def select(self, rows: NDArray[np.intp]) -> ErrorSource:
        """Return the source for a subset of the observations."""
        return replace(self, columns=self.columns[rows])


@dataclass(frozen=True, slots=True, eq=False)
class UncertainValues:
    """Values with independent and shared errors."""

    value: Array  # (n,)
    standard_error: Array  # (n,) of independent errors; nan where not stated
    error_sources: tuple[ErrorSource, ...]  # shared by rows

    @property
    def total_error(self) -> Array:
        """Total standard error of each row (n,), independent and shared parts."""
        shared = [np.sum(source.columns**2, axis=1) for source in self.error_sources]
        total: Array = np.sqrt(self.standard_error**2 + sum(shared))
        return total


def effective_dof(contributions: Array, dof: Array, scatters: Sequence[str] = ()) -> float:
    """Return the degrees of freedom of a combined uncertainty (Welch-Satterthwaite, GUM G.2b).

    Args:
        contributions: (s,) of independent sources.
        dof: (s,) of each; inf for a stated uncertainty.
        scatters: (s,) names of the scatters that they were estimated from; sources of one name
            share its degrees of freedom and are fully correlated; empty if all are independent.
    """
    variances, same = contributions**2, np.eye(len(contributions))
    for index, name in enumerate(scatters):
        if name:
            same[index] = [other == name for other in scatters]
    denominator = float(variances @ same @ (variances / dof))
    return float(variances.sum()) ** 2 / denominator if denominator > 0.0 else np.inf


class Whitening:
    """Whitening of residuals to independent unit variance: rows (m, ...) -> V^(-1/2) rows.

    V = diag(sigma^2) + columns @ columns.T. Rows are divided by `sigma` and then multiplied by the
    symmetric inverse square root of the remaining matrix, which keeps each row closest to its own
    point (Kessy, Lewin and Strimmer, Am. Stat. 72, 2018, "ZCA-cor"), so outliers stay outliers.
    Without columns, only the division is done.

    Attributes:
        sigma: (m,) the independent errors.
        directions: (m, r) orthonormal directions of the shared covariance over `sigma`, with the
            smallest number of independent draws.
        size: (r,) standard deviations along them.
    """

    def __init__(self, sigma: Array, columns: Array) -> None:
        self.sigma, self.directions = sigma, columns / sigma[:, None]
        self.size = np.zeros(columns.shape[1])
        if not columns.size:
            return
        # Use the smaller of the two products; usually there are fewer draws than points.
        if columns.shape[1] < columns.shape[0]:
            square, axes = np.linalg.eigh(self.directions.T @ self.directions)
            size = np.sqrt(np.maximum(square, 0.0))
            is_significant = size > 1e-7 * max(float(size[-1]), 1e-300)
            self.size = size[is_significant]
            self.directions = self.directions @ (axes[:, is_significant] / self.size)
        else:
            self.directions, self.size, _ = np.linalg.svd(self.directions, full_matrices=False)

    @property
    def shared(self) -> Array:
        """Columns (m, r) of the shared covariance over `sigma`."""
        return self.directions * self.size

    @property
    def log_root_excess(self) -> float:
        """0.5 log det V minus the sum of log sigma; 0 without columns."""
        return 0.5 * float(np.log1p(self.size**2).sum())

    def scaled(self, factor: float) -> Whitening:
        """Return the whitening with the independent errors times a factor."""
        scaled = copy(self)
        scaled.sigma, scaled.size = self.sigma * factor, self.size / factor
        return scaled

    @property
    def independent(self) -> Whitening:
        """Whitening with the independent errors only."""
        return Whitening(self.sigma, np.empty((len(self.sigma), 0)))

    def __call__(self, rows: Array) -> Array:
        """Return whitened rows (m,) or (m, n)."""
        scaled = (rows.T / self.sigma).T
        if not self.directions.size:
            return scaled
        change = 1.0 / np.sqrt(1.0 + self.size**2) - 1.0
        shared = self.directions.T @ scaled
        whitened: Array = scaled + self.directions @ (change * shared.T).T
        return whitened
