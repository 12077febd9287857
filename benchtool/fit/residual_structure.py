"""What residuals still hold: too much of it, order in it, single points far out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, ndtr, stdtr

from benchtool.core.array import Array

UNLIKELY = 1e-3
"""A chance below this is reported."""


@dataclass(frozen=True, slots=True)
class SignRuns:
    """Signs of residuals ordered by a column: fewer runs than chance means a curve was missed."""

    column: str
    runs: int
    expected: float
    chance: float


@dataclass(frozen=True, slots=True)
class Trend:
    """Rank correlation of residuals with a column."""

    column: str
    correlation: float
    chance: float


@dataclass(frozen=True, slots=True)
class Bend:
    """Curvature of residuals over a column: above 0 for a U, below 0 for an arch."""

    column: str
    curvature: float
    chance: float


def bend_along(column: str, order: Array, rows: Array) -> Bend:
    """Return the curvature of weighted residuals (m,) over a column (m,).

    It is that of a parabola through them, over the half width of the column; the chance is that of
    Student's t for its last coefficient. Counting runs cannot see a U in ten points; this can.
    """
    width = 0.5 * np.ptp(order) if len(order) else 0.0
    if len(rows) < 5 or width == 0.0 or len(np.unique(order)) < 4:
        return Bend(column, 0.0, 1.0)
    x = (order - order.min()) / width - 1.0
    powers = np.stack([np.ones_like(x), x, x * x], axis=1)
    inverse = np.linalg.pinv(powers.T @ powers)
    found = inverse @ (powers.T @ rows)
    left = rows - powers @ found
    dof = len(rows) - 3
    sd = float(np.sqrt(left @ left / dof * inverse[2, 2]))
    if sd <= 1e-12 * abs(found[2]):
        return Bend(column, float(found[2]), 0.0 if abs(found[2]) > 1e-9 else 1.0)
    chance = 2.0 * float(stdtr(dof, -abs(found[2]) / sd))
    return Bend(column, float(found[2]), chance)


def runs_along(column: str, order: Array, rows: Array) -> SignRuns:
    """Count runs of equal sign of weighted residuals (m,) along a column (m,).

    Points of equal column value stand for one, by their mean. The chance is that of so few runs
    (Wald and Wolfowitz, Ann. Math. Stat. 11, 1940), normal approximation.
    """
    values, place = np.unique(order, return_inverse=True)
    means = np.bincount(place, rows) / np.bincount(place)
    positive = means > 0.0
    up, down = int(positive.sum()), int((~positive).sum())
    n = len(values)
    runs = 1 + int((positive[1:] != positive[:-1]).sum()) if n else 0
    if up < 3 or down < 3:
        return SignRuns(column, runs, float(runs), 1.0)
    expected = 1.0 + 2.0 * up * down / n
    variance = 2.0 * up * down * (2.0 * up * down - n) / (n * n * (n - 1.0))
    return SignRuns(
        column, runs, expected, float(ndtr((runs + 0.5 - expected) / np.sqrt(variance)))
    )


def trend_along(column: str, order: Array, rows: Array) -> Trend:
    """Return Spearman's rank correlation of weighted residuals (m,) with a column (m,)."""
    m = len(rows)
    a, b = _ranks(order), _ranks(rows)
    if m < 5 or np.ptp(a) == 0.0 or np.ptp(b) == 0.0:
        return Trend(column, 0.0, 1.0)
    r = float(np.corrcoef(a, b)[0, 1])
    t = abs(r) * np.sqrt((m - 2.0) / max(1.0 - r * r, 1e-12))
    return Trend(column, r, 2.0 * float(stdtr(m - 2, -t)))


def outliers(rows: Array) -> NDArray[np.intp]:
    """Return points (k,) so far out that fewer than 0.05 of their kind were expected (Chauvenet).

    The worst comes first.
    """
    chance = 2.0 * ndtr(-np.abs(rows)) * len(rows)
    far = np.flatnonzero(chance < 0.05)
    return far[np.argsort(-np.abs(rows[far]))].astype(np.intp)


def chi2_chance(chi2: float, dof: int) -> float:
    """Return the chance of a chi-square at least this large."""
    return float(chdtrc(dof, chi2)) if dof > 0 else float("nan")


def _ranks(values: Array) -> Array:
    """Return ranks (m,), equal values sharing their mean rank."""
    _, place, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    mean_rank: Array = (last - 0.5 * (counts - 1.0))[place]
    return mean_rank
