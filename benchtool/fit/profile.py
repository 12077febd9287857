"""Profile-likelihood intervals, for models whose covariance at the minimum is misleading.

At an interval end the minimum chi-square over all other parameters has increased by the square of
the half width in standard deviations.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from benchtool.core.errors import EstimationError
from benchtool.core.fit_result import Estimate, FitResult
from benchtool.fit.interval import half_widths
from benchtool.fit.least_squares import parameter_dof
from benchtool.fit.problem import Problem
from benchtool.fit.solve import RANK_LIMIT, estimate_covariance, row_jacobian, solve

MAX_SEARCH_SDS = 64.0  # search range of an end in standard deviations; beyond: the bound


def add_profile_intervals(problem: Problem, result: FitResult) -> FitResult:
    """Return a least-squares result of linear loss with intervals of all shape parameters."""
    if result.method != "least_squares" or result.facts.get("loss") != "linear":
        raise EstimationError(
            "profile intervals need a least-squares result with linear loss; fit that first"
        )
    fitted = problem.at(result.values)
    profiled = {name: _profile(fitted, result, result[name]) for name in problem.shape_names}
    return replace(
        result,
        estimates=tuple(profiled.get(estimate.name, estimate) for estimate in result.estimates),
        facts={**result.facts, "intervals": f"profile: {', '.join(profiled)}"},
    )


def _profile(problem: Problem, result: FitResult, estimate: Estimate) -> Estimate:
    if not np.isfinite(estimate.sd) or estimate.sd <= 0.0:
        return estimate
    shape, noise = problem.split(result.values)
    whitening = problem.whitening(noise)
    min_chi2 = float(np.sum(problem.rows(shape, whitening) ** 2))
    method = next(name for name in RANK_LIMIT if name == result.facts.get("derivatives"))
    position = problem.shape_names.index(estimate.name)
    others = np.delete(shape, position)
    parameter = problem.parameters[estimate.name]

    def rise(value: float, target: float) -> float:
        nonlocal others
        if len(shape) == 1:
            rows = problem.rows(np.array([value]), whitening)
            return float(rows @ rows) - min_chi2 - target
        solution = solve(problem.fixed(estimate.name, value), whitening, others, method=method)
        others = solution.shape
        return solution.chi2 - min_chi2 - target

    def find_end(side: float, width: float) -> float:
        nonlocal others
        others = np.delete(shape, position)
        bound = parameter.upper if side > 0 else parameter.lower
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

    jacobian = row_jacobian(problem, method, shape, whitening)
    covariance = estimate_covariance(jacobian, method).covariance
    dof, growth = parameter_dof(problem, jacobian, covariance, whitening)
    widths = [float(growth[position]) * width for width in half_widths(float(dof[position]))]
    interval_68, interval_95 = ((find_end(-1.0, width), find_end(1.0, width)) for width in widths)
    return replace(estimate, interval_68=interval_68, interval_95=interval_95)
