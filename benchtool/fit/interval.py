"""Interval estimates: reported probabilities and their half widths in standard deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from scipy.special import chdtri, ndtri, stdtrit

from benchtool.core.errors import EstimationError
from benchtool.core.fit_result import Estimate, FitResult
from benchtool.core.parameter import Parameter
from benchtool.core.units import Array
from benchtool.fit.solve import derivatives, select_method
from benchtool.physics.effects.effect import Derived

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


def with_derived(result: FitResult, quantities: Sequence[Derived]) -> FitResult:
    """Return the result with derived quantities.

    Least squares uses the delta method with exact derivatives; emcee evaluates every draw. A
    quantity has notes on inputs at a bound or not determined.
    """
    derived = []
    for quantity in quantities:
        is_sampled = len(result.samples) > 0
        estimate = (_from_draws if is_sampled else _from_covariance)(quantity, result)
        values = _AccessRecorder({item.name: item.value for item in result.estimates})
        quantity.function(values)
        inputs = [item for item in result.estimates if item.name in values.names]
        bound = "; ".join(f"{item.name} {item.bound}" for item in inputs if item.bound)
        open_ = "; ".join(f"{item.name} is not" for item in inputs if item.open) or estimate.open
        derived.append(replace(estimate, bound=bound, open=open_))
    return replace(result, derived=(*result.derived, *derived))


class _AccessRecorder(dict[str, float]):
    """Mapping that records the names of the values that are read."""

    def __init__(self, values: Mapping[str, float]) -> None:
        super().__init__(values)
        self.names: set[str] = set()

    def __getitem__(self, name: str) -> float:
        self.names.add(name)
        return super().__getitem__(name)


def _from_draws(quantity: Derived, result: FitResult) -> Estimate:
    draws = _evaluate(quantity, result, result.samples.T)
    finite = np.broadcast_to(np.asarray(draws, float), (len(result.samples),))
    if not np.all(np.isfinite(finite)):
        raise EstimationError(
            f"{quantity.name} has no finite value for {np.sum(~np.isfinite(finite))} of "
            f"{len(finite)} draws; narrow the bounds of its parameters"
        )
    return from_draws(quantity.name, Parameter(quantity.name, quantity.unit, 0.0), finite)


def _evaluate(quantity: Derived, result: FitResult, values: Any) -> Any:
    """Return a quantity at values (n_free, ...) of the estimates."""
    names = (estimate.name for estimate in result.estimates)
    return np.asarray(quantity.function(dict(zip(names, values, strict=True))))


def delta_gradient(quantity: Derived, result: FitResult) -> Array:
    """Return the gradient (n_free,) of a quantity with respect to the estimates."""
    values, predict = result.values, partial(_evaluate, quantity, result)
    unbounded = np.full(len(values), np.inf)
    method = select_method(predict, values, 1, -unbounded, unbounded)
    gradient: Array = derivatives(predict, values, 1, (-unbounded, unbounded), method)[0]
    return gradient


def _from_covariance(quantity: Derived, result: FitResult) -> Estimate:
    gradient = delta_gradient(quantity, result)
    used = gradient != 0.0
    covariance = result.covariance[np.ix_(used, used)]
    sd = float(np.sqrt(gradient[used] @ covariance @ gradient[used]))
    has_noise = any(estimate.name.startswith("noise.") for estimate in result.estimates)
    return interval_around(
        quantity.name,
        Parameter(quantity.name, quantity.unit, 0.0),
        float(_evaluate(quantity, result, result.values)),
        sd,
        half_widths(result.dof if has_noise else np.inf),
    )
