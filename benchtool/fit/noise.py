"""Noise parameter in least squares: the value at which chi-square equals its dof.

Shape parameters and noise are solved alternately: the shape is refitted for each noise value until
chi2 = dof (Mandel and Paule, Anal. Chem. 42, 1970, for `noise.sd`; for `noise.scale` without
priors, unscaled sources or a fixed `noise.sd` this is the usual sqrt(chi2/dof) in one step). The
interval ends are the noise values at which chi2 equals its quantiles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import chdtri

from benchtool.core.errors import EstimationError
from benchtool.core.fit_result import Estimate
from benchtool.core.text import pluralize
from benchtool.fit.interval import PROBABILITIES, chi2_limits, is_at_bound
from benchtool.fit.problem import NOISE_PLACE, NOISE_SCALE, Problem
from benchtool.fit.robust import MAD_EFFICIENCY, robust_scale
from benchtool.fit.solve import Solution

MAX_STEPS = 60  # of a search for the noise; four or five are usual

Refit = Callable[[float, Solution], Solution]  # refit(noise, near) -> solution with that noise


def fit_noise(
    problem: Problem, first: Solution, refit: Refit, robust: bool
) -> tuple[Estimate, Solution]:
    """Return the fitted noise with its intervals, and the shape's solution at that noise.

    The search starts from `first`, the solution at the initial noise value.
    """
    name = problem.noise_name
    assert name is not None
    if problem.dof < 1:
        raise EstimationError(
            f"no degree of freedom is left to estimate {name}: {pluralize(len(problem), 'point')}, "
            f"{pluralize(len(problem.shape_names), 'other parameter')}; measure more points or fix "
            f"{name}"
        )
    # At a scale of 0 only a fixed `noise.sd` is left of the errors.
    is_one_factor = all(source.scaled for source in problem.error_sources)
    is_one_factor = is_one_factor and not problem.sigma(0.0).any() and not len(problem.priors)
    if name == NOISE_SCALE and (robust or is_one_factor):
        return _fit_scale(problem, first, refit, robust)
    if name == NOISE_PLACE:
        return _fit_place(problem, first, refit)
    return _fit_by_search(problem, name, first, refit)


PLACE_RANGE = (1e-3, 1e2)  # search range, multiples of the initial position scatter


def _fit_place(problem: Problem, first: Solution, refit: Refit) -> tuple[Estimate, Solution]:
    """Return the plate position scatter of maximum restricted likelihood, with its profile.

    chi2 = dof would give points within a stay, which contain no information on position scatter,
    the same weight as stays (Patterson and Thompson, Biometrika 58, 1971).
    """
    parameter, latest = problem.parameters[NOISE_PLACE], first
    low, high = (float(np.log(parameter.value * factor)) for factor in PLACE_RANGE)

    def loss(log_place: float) -> float:
        nonlocal latest
        latest = refit(float(np.exp(log_place)), latest)
        determinant = np.linalg.slogdet(latest.jacobian.T @ latest.jacobian)[1]
        value = 0.5 * (latest.chi2 + float(determinant))
        if latest.jacobian.shape[1] > len(latest.shape):
            return value  # the determinant of shape and shared errors contains that of V
        return value + problem.whitening(float(np.exp(log_place))).log_root_excess

    minimum = minimize_scalar(loss, bounds=(low, high), method="bounded", options={"xatol": 1e-4})
    best_log, min_loss = float(minimum.x), float(minimum.fun)

    def find_end(limit: float, side: float) -> float:
        if loss(side) - min_loss < 0.5 * limit:
            return 0.0 if side == low else parameter.upper
        a, b = sorted((side, best_log))
        return float(np.exp(brentq(lambda x: loss(x) - min_loss - 0.5 * limit, a, b, xtol=1e-4)))

    value = float(np.exp(best_log))
    solution = refit(value, latest)
    limits = (float(chdtri(1, 1.0 - p)) for p in PROBABILITIES)
    interval_68, interval_95 = ((find_end(q, low), find_end(q, high)) for q in limits)
    sd = 0.5 * (interval_68[1] - interval_68[0])
    return Estimate(NOISE_PLACE, parameter.unit, value, sd, interval_68, interval_95), solution


def _fit_scale(
    problem: Problem, first: Solution, refit: Refit, robust: bool
) -> tuple[Estimate, Solution]:
    """Return the scale in closed form, or by the median absolute residual under a robust loss."""
    parameter, dof = problem.parameters[NOISE_SCALE], float(problem.dof)
    value, solution = parameter.value, first
    if robust:
        for _ in range(20):
            dof = solution.points_dof(len(problem))
            factor = max(robust_scale(solution.rows[: len(problem)], dof), 1e-300)
            value *= factor
            solution = refit(value, solution)
            if abs(factor - 1.0) < 1e-6:
                break
    else:
        value *= float(np.sqrt(solution.chi2 / problem.dof))
        factor = parameter.value / value if value > 0.0 else 1.0
        solution = replace(
            solution,
            rows=solution.rows * factor,
            jacobian=solution.jacobian * factor,
            cost=solution.cost * factor**2,
        )
    dof *= MAD_EFFICIENCY if robust else 1.0
    interval_68, interval_95 = (
        (value * float(np.sqrt(dof / high)), value * float(np.sqrt(dof / low)))
        for low, high in chi2_limits(dof)
    )
    sd = value / float(np.sqrt(2.0 * dof))
    return Estimate(NOISE_SCALE, parameter.unit, value, sd, interval_68, interval_95), solution


def _fit_by_search(
    problem: Problem, name: str, first: Solution, refit: Refit
) -> tuple[Estimate, Solution]:
    parameter = problem.parameters[name]
    typical = float(np.sqrt(np.mean(problem.standard_error**2)))
    unit = 1.0 if name == NOISE_SCALE else typical
    lower = max(parameter.lower, 1e-3 * unit if name == NOISE_SCALE else 0.0)
    x_min, x_max = lower**2, min(parameter.upper, 1e9 * unit) ** 2
    latest = first

    def inverse(x: float) -> float:
        """Return y = 1 / chi2 at x, the squared noise, for a secant search: concave in x."""
        nonlocal latest
        latest = refit(x**0.5, latest)
        return 1.0 / max(latest.chi2, 1e-300)

    def solve_noise(target: float, guess: float, tolerance: float) -> float:
        x, low, high = float(np.clip(guess**2, max(x_min, 1e-6 * unit**2), x_max)), x_min, x_max
        x_0, y_0 = 0.0, 0.0
        for _ in range(MAX_STEPS):
            y = inverse(x)
            excess = target * y - 1.0
            if (excess >= 0.0 and x == x_min) or (excess <= 0.0 and x == x_max):
                break
            low, high = (low, x) if excess > 0.0 else (x, high)
            step = x - (y - 1.0 / target) * ((x - x_0) / (y - y_0) if y != y_0 else 0.0)
            x_0, y_0, before = x, y, x
            x = float(np.clip(step, low, high))
            if abs(x - before) <= tolerance * max(before, 1e-6 * unit**2):
                break
        return float(np.sqrt(x))

    value = solve_noise(float(problem.dof), unit, 1e-9)
    solution = refit(value, latest)

    def find_end(limit: float) -> float:
        return solve_noise(limit, value * float(np.sqrt(problem.dof / limit)), 1e-6)

    ends = [(find_end(high), find_end(low)) for low, high in chi2_limits(problem.dof)]
    interval_68, interval_95 = ((low, high) for low, high in ends)
    sd = 0.5 * (interval_68[1] - interval_68[0])
    bound = is_at_bound(replace(parameter, lower=lower), value, sd)
    return Estimate(name, parameter.unit, value, sd, interval_68, interval_95, bound), solution
