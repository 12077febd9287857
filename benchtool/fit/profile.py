"""Profile-likelihood intervals: how far one parameter goes while all others give way.

Where a model bends, the covariance at the minimum misleads and the profile does not. An end of an
interval is where the least chi-square over all other parameters has risen by the square of the
interval's half width in standard deviations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from benchtool.core.errors import EstimationError
from benchtool.core.fit_result import Estimate, FitResult
from benchtool.fit.interval import half_widths
from benchtool.fit.jacobian import Way, spread_of
from benchtool.fit.problem import Problem
from benchtool.fit.solve import row_jacobian, solve
from benchtool.fit.uncertainty.parameter_dof import parameter_dof

MAX_SEARCH_SDS = 64.0  # an end farther than this many standard deviations counts as not there


def add_profile_intervals(
    problem: Problem, result: FitResult, names: Sequence[str] | None = None
) -> FitResult:
    """Return a least-squares result whose intervals come from profiles.

    Args:
        result: of `fit_least_squares`, with its plain loss.
        names: parameters to do; all that move the prediction when left out.
    """
    if result.method != "least_squares" or result.facts.get("loss") != "linear":
        raise EstimationError(
            "profile intervals need a least-squares result with linear loss; fit that first"
        )
    wanted = problem.shape_names if names is None else tuple(names)
    fitted = problem.at(result.values)
    profiled = {
        name: _profiled(fitted, result, result[name])
        for name in wanted
        if name in fitted.free_names
    }
    return replace(
        result,
        estimates=tuple(profiled.get(item.name, item) for item in result.estimates),
        facts={**result.facts, "intervals": f"profile: {', '.join(profiled)}"},
    )


def _profiled(problem: Problem, result: FitResult, estimate: Estimate) -> Estimate:
    if not np.isfinite(estimate.sd) or estimate.sd <= 0.0:
        return estimate
    shape, noise = problem.split(result.values)
    whitening = problem.whitening(noise)
    least = float(np.sum(problem.rows(shape, whitening) ** 2))
    way: Way = (
        "complex_step"
        if result.facts.get("derivatives") == "complex_step"
        else "central_differences"
    )
    position = problem.shape_names.index(estimate.name)
    others = np.delete(shape, position)
    item = problem.parameters[estimate.name]

    def rise(value: float, target: float) -> float:
        nonlocal others
        held = problem.fixed(estimate.name, value) if len(shape) > 1 else None
        if held is None:
            rows = problem.rows(np.array([value]), whitening)
            return float(rows @ rows) - least - target
        solution = solve(held, whitening, others, way=way)
        others = solution.shape
        return solution.chi2 - least - target

    def end(side: float, width: float) -> float:
        nonlocal others
        others = np.delete(shape, position)
        bound = item.upper if side > 0 else item.lower
        near, reach = estimate.value, 0.7 * width
        while reach < MAX_SEARCH_SDS * width:
            far = estimate.value + side * reach * estimate.sd
            stopped = side * (far - bound) >= 0.0
            far = bound if stopped else far
            if rise(far, width**2) > 0.0:
                precision = 1e-5 * estimate.sd
                return float(brentq(rise, near, far, args=(width**2,), xtol=precision))
            if stopped:
                return float(bound)
            near, reach = far, 1.6 * reach
        return float(bound)

    jacobian = row_jacobian(problem, way)(shape, whitening)
    dof, growth = parameter_dof(problem, jacobian, spread_of(jacobian, way).covariance, whitening)
    widths = [float(growth[position]) * width for width in half_widths(float(dof[position]))]
    one, two = ((end(-1.0, width), end(1.0, width)) for width in widths)
    return replace(estimate, interval_68=one, interval_95=two)
