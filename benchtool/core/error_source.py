"""Errors that several observations share, and the whitening of residuals by all errors together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from benchtool.core.array_type import Array

Distribution = Literal["normal", "uniform", "triangular", "student_t"]
"""Of one draw, with standard deviation 1 (JCGM 101:2008, 6.4); "student_t" takes the `dof`."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ErrorSource:
    """State one cause of error that moves several observations by the same draws.

    The observations' covariance gains `columns @ columns.T`. A reference shared by ratios has one
    column for each reference, a place error one for each stay, a scale error one altogether, a
    wandering zero the columns of a root of its covariance.

    Attributes:
        kind: how it was evaluated (JCGM 100:2008, 3.3): "A" from scatter, "B" otherwise.
        sd: standard deviation of one draw, in `unit`; typical where draws differ.
        dof: degrees of freedom that `sd` was evaluated with.
        columns: (m, r) change of each observation by one standard deviation of each of r
            independent draws, in the unit of what was observed.
        scaled: whether `noise.scale` multiplies it as it does the points' own standard errors:
            scatter of the same kind, such as that of reference points.
        origin: who states or assumes it, for an uncertainty budget.
        parameter: the noise parameter that stands for `sd` where it is free; empty without.
        scatter: name of the scatter that `sd` was estimated from, where other sources have theirs
            from the same; empty where it is the source's own.
    """

    name: str
    kind: Literal["A", "B"]
    unit: str
    sd: float
    columns: Array
    distribution: Distribution = "normal"
    dof: float = np.inf
    scaled: bool = False
    origin: str = ""
    parameter: str = ""
    scatter: str = ""

    def of(self, rows: NDArray[np.intp]) -> ErrorSource:
        """Return the source of only those observations."""
        return replace(self, columns=self.columns[rows])


@dataclass(frozen=True, slots=True, eq=False)
class UncertainValues:
    """Hold numbers with their own errors and those that they share."""

    value: Array  # (n,)
    standard_error: Array  # (n,) what a row's own errors make; nan where none are stated
    error_sources: tuple[ErrorSource, ...]  # what rows share

    @property
    def total_error(self) -> Array:
        """Standard error of each row by itself (n,): its own part and the shared ones."""
        shared = [np.sum(source.columns**2, axis=1) for source in self.error_sources]
        out: Array = np.sqrt(self.standard_error**2 + sum(shared))
        return out


def concatenate_sources(parts: Sequence[Sequence[ErrorSource]]) -> tuple[ErrorSource, ...]:
    """Return the sources of parts laid one after the other, each part with draws of its own.

    Every part has the same sources in the same order.
    """
    return tuple(
        replace(
            each[0],
            sd=float(np.sqrt(np.mean([one.sd**2 for one in each]))),
            columns=block_diag(*(one.columns for one in each)),
        )
        for each in zip(*parts, strict=True)
    )


def effective_dof(contributions: Array, dof: Array, scatters: Sequence[str] = ()) -> float:
    """Return the degrees of freedom of a combined uncertainty (Welch-Satterthwaite, GUM G.2b).

    Args:
        contributions: (s,) of independent sources.
        dof: (s,) of each; inf where its uncertainty is stated.
        scatters: (s,) names of the scatters that they were estimated from: those of one name
            share its degrees of freedom, and are too small or too large together; empty where
            each has its own.
    """
    variances, same = contributions**2, np.eye(len(contributions))
    for place, name in enumerate(scatters):
        if name:
            same[place] = [other == name for other in scatters]
    spent = float(variances @ same @ (variances / dof))
    return float(variances.sum()) ** 2 / spent if spent > 0.0 else np.inf


class Whitening:
    """Make residuals independent and of variance 1: rows (m, ...) -> V^(-1/2) rows (m, ...).

    V = diag(sigma^2) + columns @ columns.T. Rows are divided by `sigma` and then multiplied by the
    symmetric root of the inverse of what is left, the root that leaves each row nearest to its own
    point (Kessy, Lewin and Strimmer, Am. Stat. 72, 2018, "ZCA-cor"): an outlier stays one.
    Without columns it is the division alone.

    Attributes:
        sigma: (m,) the independent errors.
        log_root_excess: log of the root of det V less the sum of log sigma; 0 without columns.
        shared: (m, r) change of rows divided by `sigma` by independent standard normal draws, as
            few as make the covariance of `columns`.
    """

    def __init__(self, sigma: Array, columns: Array) -> None:
        self.sigma = sigma
        self.log_root_excess = 0.0
        self._directions, size = columns / sigma[:, None], np.zeros(columns.shape[1])
        if columns.size:
            # By the smaller of the two products: draws are fewer than points, mostly.
            if columns.shape[1] < columns.shape[0]:
                square, axes = np.linalg.eigh(self._directions.T @ self._directions)
                size = np.sqrt(np.maximum(square, 0.0))
                shown = size > 1e-7 * max(float(size[-1]), 1e-300)
                size = size[shown]
                self._directions = self._directions @ (axes[:, shown] / size)
            else:
                self._directions, size, _ = np.linalg.svd(self._directions, full_matrices=False)
            self._change = 1.0 / np.sqrt(1.0 + size**2) - 1.0
            self.log_root_excess = 0.5 * float(np.log1p(size**2).sum())
        self.shared: Array = self._directions * size

    @property
    def own(self) -> Whitening:
        """Division by the independent errors alone."""
        return Whitening(self.sigma, np.empty((len(self.sigma), 0)))

    def __call__(self, rows: Array) -> Array:
        """Return whitened rows (m,) or (m, n)."""
        own = (rows.T / self.sigma).T
        if not self._directions.size:
            return own
        shared = self._directions.T @ own
        out: Array = own + self._directions @ (self._change * shared.T).T
        return out
