"""Interval estimates: reported probabilities and their half widths in standard deviations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import chdtri, ndtri, stdtrit

from benchtool.core.errors import EstimationError
from benchtool.core.fit_result import Estimate, FitResult
from benchtool.core.parameter import Parameter
from benchtool.core.units import Array
from benchtool.fit.jacobian import central_differences, complex_step, select_method
from benchtool.physics.effects.effect import Derived

PROBABILITIES = (0.6827, 0.95)  # 68 %: one standard deviation of a normal distribution


def half_widths(dof: float | None) -> tuple[float, float]:
    """Return the two half widths in standard deviations.

    Args:
        dof: degrees of freedom that the scale of the errors was estimated from (Student's t);
            None when the errors were stated (normal).
    """
    upper = [0.5 + 0.5 * p for p in PROBABILITIES]
    nu = np.inf if dof is None else dof
    width_68, width_95 = (ndtri(p) if np.isinf(nu) else stdtrit(nu, p) for p in upper)
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

    Least squares uses the delta method with exact derivatives; emcee evaluates every draw.
    """
    names = [estimate.name for estimate in result.estimates]
    estimates = tuple(
        _from_draws(quantity, names, result)
        if len(result.samples)
        else _from_covariance(quantity, names, result)
        for quantity in quantities
    )
    pairs = zip(estimates, quantities, strict=True)
    derived = tuple(_with_bound_notes(*pair, result) for pair in pairs)
    return replace(result, derived=(*result.derived, *derived))


class _AccessRecorder(dict[str, float]):
    """Mapping that records the names of the values that are read."""

    def __init__(self, values: Mapping[str, float]) -> None:
        super().__init__(values)
        self.names: set[str] = set()

    def __getitem__(self, name: str) -> float:
        self.names.add(name)
        return super().__getitem__(name)


def _with_bound_notes(derived: Estimate, quantity: Derived, result: FitResult) -> Estimate:
    """Return a derived quantity with notes on inputs at a bound or not determined."""
    values = _AccessRecorder({item.name: item.value for item in result.estimates})
    quantity.function(values)
    inputs = [item for item in result.estimates if item.name in values.names]
    return replace(
        derived,
        bound="; ".join(f"{item.name} {item.bound}" for item in inputs if item.bound),
        open="; ".join(f"{item.name} is not" for item in inputs if item.open) or derived.open,
    )


def _from_draws(quantity: Derived, names: Sequence[str], result: FitResult) -> Estimate:
    draws = quantity.function(dict(zip(names, result.samples.T, strict=True)))
    finite = np.broadcast_to(np.asarray(draws, float), (len(result.samples),))
    if not np.all(np.isfinite(finite)):
        raise EstimationError(
            f"{quantity.name} has no finite value for {np.sum(~np.isfinite(finite))} of "
            f"{len(finite)} draws; narrow the bounds of its parameters"
        )
    return from_draws(quantity.name, Parameter(quantity.name, quantity.unit, 0.0), finite)


def delta_gradient(quantity: Derived, result: FitResult) -> Array:
    """Return the gradient (n_free,) of a quantity with respect to the estimates."""
    names, values = [estimate.name for estimate in result.estimates], result.values

    def predict(values: Any) -> Any:
        return np.asarray(quantity.function(dict(zip(names, values, strict=True))))

    unbounded = np.full(len(values), np.inf)
    if select_method(predict, values, 1, -unbounded, unbounded) == "complex_step":
        gradient: Array = complex_step(predict, values, 1)[0]
    else:
        gradient = central_differences(predict, values, 1, -unbounded, unbounded)[0]
    return gradient


def _from_covariance(quantity: Derived, names: Sequence[str], result: FitResult) -> Estimate:
    gradient = delta_gradient(quantity, result)
    used = gradient != 0.0
    covariance = result.covariance[np.ix_(used, used)]
    sd = float(np.sqrt(gradient[used] @ covariance @ gradient[used]))
    dof = result.dof if any(name.startswith("noise.") for name in names) else None
    return interval_around(
        quantity.name,
        Parameter(quantity.name, quantity.unit, 0.0),
        float(quantity.function(dict(zip(names, result.values, strict=True)))),
        sd,
        half_widths(dof),
    )
