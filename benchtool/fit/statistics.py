"""Statistics of fits: intervals, robust losses and scales, structure and outliers of residuals."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, ndtr, ndtri, stdtr, stdtrit

from benchtool.core.choices import Loss
from benchtool.core.fit_result import Estimate
from benchtool.core.parameter import Parameter
from benchtool.core.units import Array

PROBABILITIES = (0.6827, 0.95)  # 68 %: one standard deviation of a normal distribution


def half_widths(dof: float) -> tuple[float, float]:
    """Return the two half widths in standard deviations.

    Args:
        dof: degrees of freedom that the scale of the errors was estimated from (Student's t);
            inf when the errors were stated (normal).
    """
    upper = [0.5 + 0.5 * p for p in PROBABILITIES]
    width_68, width_95 = (ndtri(p) if np.isinf(dof) else stdtrit(dof, p) for p in upper)
    return float(width_68), float(width_95)


def chi2_limits(dof: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return (low, high) chi-square quantiles that enclose each probability."""
    limits_68, limits_95 = (
        (float(chdtri(dof, 0.5 + 0.5 * p)), float(chdtri(dof, 0.5 - 0.5 * p)))
        for p in PROBABILITIES
    )
    return limits_68, limits_95


NEAR_BOUND = 1e-3  # in standard deviations; a value nearer to a bound is at the bound


def is_at_bound(parameter: Parameter, value: float, sd: float) -> str:
    """Return text that names the bound of a value at a bound, else ""."""
    near = NEAR_BOUND * sd if np.isfinite(sd) else 0.0
    for side, bound in (("lower", parameter.lower), ("upper", parameter.upper)):
        if np.isfinite(bound) and abs(value - bound) <= near:
            return f"at its {side} bound"
    return ""


FULL_RANGE = 0.93  # share of the bounds that an uninformative 95 % interval covers (uniform: 0.95)


def open_interval_reason(parameter: Parameter, sd: float, interval_95: tuple[float, float]) -> str:
    """Return text with the reason why data do not determine a parameter, else ""."""
    if np.isnan(sd):
        return ""
    if np.isinf(sd):
        return "the data leave it open"
    allowed, (low, high) = parameter.upper - parameter.lower, interval_95
    if np.isfinite(allowed) and high - low >= FULL_RANGE * allowed > 0.0:
        return (
            f"its 95 % interval is all that its bounds allow, {parameter.lower:.3g} to "
            f"{parameter.upper:.3g}"
        )
    return ""


def interval_around(
    name: str, parameter: Parameter, value: float, sd: float, widths: tuple[float, float]
) -> Estimate:
    """Return an estimate with symmetric intervals, truncated at the parameter's bounds."""
    low, high = parameter.lower, parameter.upper
    interval_68, interval_95 = (
        (float(max(low, value - width * sd)), float(min(high, value + width * sd)))
        if np.isfinite(sd)
        else (low, high)
        for width in widths
    )
    bound = is_at_bound(parameter, value, sd)
    open_ = open_interval_reason(parameter, float(sd), interval_95)
    numbers = (float(value), float(sd), interval_68, interval_95)
    return Estimate(name, parameter.unit, *numbers, bound, open_)


def from_draws(name: str, parameter: Parameter, draws: Array, bound: str = "") -> Estimate:
    """Return an estimate from posterior draws (n,): median, deviation, equal-tailed intervals."""
    levels = [0.5 + 0.5 * sign * p for p in PROBABILITIES for sign in (-1.0, 1.0)]
    median, a, b, c, d = (float(q) for q in np.quantile(draws, [0.5, *levels]))
    sd = float(np.std(draws, ddof=1))
    open_reason = open_interval_reason(parameter, sd, (c, d))
    return Estimate(name, parameter.unit, median, sd, (a, b), (c, d), bound, open_reason)


HUBER_LIMIT = 1.345  # standard errors from which huber is linear: 95 % efficiency (Huber 1964)
# Variance inflation without outliers: mean(psi^2) / mean(psi')^2 over the normal distribution,
# integrated numerically. With stated errors it is the lower limit.
NORMAL_INFLATION: dict[Loss, float] = {"soft_l1": 1.0790, "huber": 1.0526}

MAD_TO_SD = 1.4826  # standard deviation of a normal distribution over its median absolute deviation

MAD_EFFICIENCY = 0.37  # on normal residuals (Rousseeuw, Croux, J. Am. Stat. Assoc. 88, 1993)


def robust_scale(rows: Array, dof: float) -> float:
    """Return the scatter of normalised residuals (m,) from their median absolute value."""
    return MAD_TO_SD * float(np.median(np.abs(rows))) * float(np.sqrt(len(rows) / max(dof, 1)))


def robust_chi2(rows: Array, dof: float) -> float:
    """Return the chi-square of residuals (m,) from their robust scale, without outliers.

    Its distribution is a scaled chi-square of `MAD_EFFICIENCY` times the degrees of freedom: in 600
    simulated fits of 10 to 100 points, 0.6 to 1.0 % are beyond the quantile of 1 %.
    """
    return max(dof, 0.0) * robust_scale(rows, dof) ** 2


def point_losses(loss: Loss, m: int) -> Callable[[Array], Array]:
    """Return rho (3, rows) of the squared rows: robust for m points, linear for the others.

    Both as defined by scipy; the change from quadratic to linear is at one standard error for
    soft_l1 and at `HUBER_LIMIT` for huber.
    """
    limit2 = HUBER_LIMIT**2 if loss == "huber" else 1.0

    def rho(squares: Array) -> Array:
        z = squares / limit2
        out = np.empty((3, len(z)))
        if loss == "soft_l1":
            root = np.sqrt(1.0 + z)
            out[0], out[1], out[2] = 2.0 * (root - 1.0), 1.0 / root, -0.5 / root**3
        else:
            near = z <= 1.0
            root = np.sqrt(np.where(near, 1.0, z))
            out[0] = np.where(near, z, 2.0 * root - 1.0)
            out[1] = np.where(near, 1.0, 1.0 / root)
            out[2] = np.where(near, 0.0, -0.5 / root**3)
        out[0, m:], out[1, m:], out[2, m:] = z[m:], 1.0, 0.0
        out[0] *= limit2
        out[2] /= limit2
        return out

    return rho


def robust_inflation(rows: Array, dof: float, loss: Loss, *, is_stated: bool) -> float:
    """Return the inflation of the points' independent variances under a robust loss.

    mean(psi^2) / mean(psi')^2 of the residuals (Huber, Robust Statistics, 1981, ch. 7).

    Args:
        rows: (m,) residuals over their independent errors.
        dof: degrees of freedom of the residuals.
        is_stated: errors are stated, not fitted; the factor of normal residuals is then a minimum.
    """
    if loss == "soft_l1":
        root = np.sqrt(1.0 + rows**2)
        psi, slope = rows / root, 1.0 / root**3
    else:
        psi = np.clip(rows, -HUBER_LIMIT, HUBER_LIMIT)
        slope = (np.abs(rows) <= HUBER_LIMIT).astype(float)
    ratio = float(np.sum(psi**2) / max(dof, 1.0) / max(float(np.mean(slope)), 1e-3) ** 2)
    return max(ratio, NORMAL_INFLATION[loss]) if is_stated else ratio


class Pattern(NamedTuple):
    """Test statistic of residuals along a column, and its p-value."""

    size: float
    chance: float
    expected: float = 0.0  # size expected for noise


def bend_along(order: Array, rows: Array) -> Pattern:
    """Return the curvature of weighted residuals (m,) over a column (m,): above 0 for a U.

    Quadratic coefficient of a parabola, per half width of the column, with Student's t test. The
    runs test cannot detect a U in ten points.
    """
    width = 0.5 * np.ptp(order) if len(order) else 0.0
    if len(rows) < 5 or width == 0.0 or len(np.unique(order)) < 4:
        return Pattern(0.0, 1.0)
    x = (order - order.min()) / width - 1.0
    powers = np.stack([np.ones_like(x), x, x * x], axis=1)
    inverse = np.linalg.pinv(powers.T @ powers)
    coefficients = inverse @ (powers.T @ rows)
    residuals = rows - powers @ coefficients
    dof = len(rows) - 3
    size, sd = float(coefficients[2]), float(np.sqrt(residuals @ residuals / dof * inverse[2, 2]))
    if sd <= 1e-12 * abs(size):
        return Pattern(size, 0.0 if abs(size) > 1e-9 else 1.0)
    return Pattern(size, 2.0 * float(stdtr(dof, -abs(size) / sd)))


def runs_along(order: Array, rows: Array) -> Pattern:
    """Count runs of equal sign of weighted residuals (m,) along a column (m,).

    Too few runs indicate a missing curve. Points of equal column value are averaged. Runs test of
    Wald and Wolfowitz (Ann. Math. Stat. 11, 1940), normal approximation.
    """
    values, position = np.unique(order, return_inverse=True)
    positive = np.bincount(position, rows) > 0.0
    runs = 1 + int((positive[1:] != positive[:-1]).sum()) if len(values) else 0
    if positive.sum() < 3 or (~positive).sum() < 3:
        return Pattern(runs, 1.0, runs)
    expected, sd = expected_runs(positive)
    return Pattern(runs, float(ndtr((runs + 0.5 - expected) / sd)), expected)


def expected_runs(positive: NDArray[np.bool_]) -> tuple[float, float]:
    """Return mean and sd of the number of runs for independent signs (Wald-Wolfowitz)."""
    above, total = int(positive.sum()), len(positive)
    mixed = 2.0 * above * (total - above)
    variance = mixed * (mixed - total) / (total**2 * (total - 1)) if total > 1 else 0.0
    return 1.0 + mixed / max(total, 1), float(np.sqrt(max(variance, 0.0)))


def trend_along(order: Array, rows: Array) -> Pattern:
    """Return Spearman's rank correlation of weighted residuals (m,) with a column (m,)."""
    if len(rows) < 5 or np.ptp(order) == 0.0 or np.ptp(rows) == 0.0:
        return Pattern(0.0, 1.0)
    ranks = np.column_stack((_ranks(order), _ranks(rows)))
    size, dof = np.asarray(np.corrcoef(ranks, rowvar=False))[1, 0], len(rows) - 2
    with np.errstate(divide="ignore"):  # a correlation of 1 has t = inf
        t = size * np.sqrt(max(dof / ((1.0 + size) * (1.0 - size)), 0.0))
    return Pattern(float(size), float(2.0 * stdtr(dof, -abs(t))))


def _ranks(values: Array) -> Array:
    """Return the rank (m,) of each value, equal values with their mean rank."""
    _, position, counts = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(counts) - 0.5 * (counts - 1.0))[position]


def outliers(rows: Array) -> NDArray[np.intp]:
    """Return outliers (k,), worst first: fewer than 0.05 points expected beyond (Chauvenet)."""
    chance = 2.0 * ndtr(-np.abs(rows)) * len(rows)
    far = np.flatnonzero(chance < 0.05)
    return far[np.argsort(-np.abs(rows[far]))].astype(np.intp)
