"""Intervals: which probabilities are reported and how many standard deviations they take."""

from __future__ import annotations

import numpy as np
from scipy.special import chdtri, ndtri, stdtrit

from benchtool.core.array import Array
from benchtool.core.fit_result import Estimate
from benchtool.core.parameter import Parameter

PROBABILITIES = (0.6827, 0.95)
"""The 68 % interval is one standard deviation of a normal distribution."""


def half_widths(dof: int | None) -> tuple[float, float]:
    """Return the two half widths in standard deviations.

    Args:
        dof: degrees of freedom that the scale of the errors was estimated from (Student's t);
            None when the errors were stated (normal).
    """
    upper = [0.5 + 0.5 * p for p in PROBABILITIES]
    one, two = (ndtri(p) if dof is None else stdtrit(dof, p) for p in upper)
    return float(one), float(two)


def chi2_limits(dof: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return (low, high) chi-square quantiles that enclose each probability."""
    one, two = (
        (float(chdtri(dof, 0.5 + 0.5 * p)), float(chdtri(dof, 0.5 - 0.5 * p)))
        for p in PROBABILITIES
    )
    return one, two


NEAR_BOUND = 1e-3
"""A value nearer to a bound than this part of its standard deviation is at the bound."""


def bound_hit(parameter: Parameter, value: float, sd: float) -> str:
    """Return at which of its bounds a value ended, in words; empty where it lies inside."""
    near = NEAR_BOUND * sd if np.isfinite(sd) else 0.0
    for side, bound in (("lower", parameter.lower), ("upper", parameter.upper)):
        if np.isfinite(bound) and abs(value - bound) <= near:
            return f"at its {side} bound"
    return ""


def around(
    name: str, parameter: Parameter, value: float, sd: float, widths: tuple[float, float]
) -> Estimate:
    """Return an estimate with symmetric intervals, cut off at the parameter's bounds."""
    low, high = parameter.lower, parameter.upper
    one, two = (
        (float(max(low, value - width * sd)), float(min(high, value + width * sd)))
        if np.isfinite(sd)
        else (low, high)
        for width in widths
    )
    hit = bound_hit(parameter, value, sd)
    return Estimate(name, parameter.unit, float(value), float(sd), one, two, hit)


def from_draws(name: str, unit: str, draws: Array, bound: str = "") -> Estimate:
    """Return an estimate from posterior draws (n,): median, deviation, equal-tailed intervals."""
    levels = [0.5 + 0.5 * sign * p for p in PROBABILITIES for sign in (-1.0, 1.0)]
    median, a, b, c, d = (float(q) for q in np.quantile(draws, [0.5, *levels]))
    return Estimate(name, unit, median, float(np.std(draws, ddof=1)), (a, b), (c, d), bound)
