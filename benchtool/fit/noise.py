"""The free noise parameter in least squares: the value at which chi-square meets its dof.

Shape parameters and noise are solved in turn: for a noise value the shape is fitted anew, and the
noise is moved until chi2 = dof (Mandel and Paule, Anal. Chem. 42, 1970, for `noise.sd`; for
`noise.scale` without priors, unscaled sources or a fixed `noise.sd` this is the usual
sqrt(chi2/dof) in one step). Its interval ends where chi2 meets its own quantiles.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import chdtri

from benchtool.core.errors import EstimationError
from benchtool.core.fit_result import Estimate
from benchtool.core.plural import pluralize
from benchtool.fit.interval import PROBABILITIES, chi2_limits, is_at_bound
from benchtool.fit.problem import NOISE_PLACE, NOISE_SCALE, Problem
from benchtool.fit.robust import MAD_EFFICIENCY, robust_scale
from benchtool.fit.solve import Solution

MOST_STEPS = 60  # of a search for the noise; four or five are enough

Refit = Callable[[float, Solution], Solution]  # refit(noise, near) -> solution with that noise


def fit_noise(
    problem: Problem, first: Solution, refit: Refit, robust: bool
) -> tuple[Estimate, Solution]:
    """Return the fitted noise with its intervals, and the shape's solution at it.

    It starts from the solution at the noise's present value.
    """
    name = problem.noise_name
    assert name is not None
    if problem.dof < 1:
        raise EstimationError(
            f"with {pluralize(len(problem), 'point')} no degree of freedom is left to estimate "
            f"{name} beside {pluralize(len(problem.shape_names), 'parameter')}; measure more "
            f"points or fix {name}"
        )
    # A fixed `noise.sd` is what is left of the errors at a scale of 0.
    one_factor = all(one.scaled for one in problem.error_sources) and not problem.sigma(0.0).any()
    one_factor = one_factor and not len(problem.priors)
    if name == NOISE_SCALE and (robust or one_factor):
        return _scale(problem, first, refit, robust)
    if name == NOISE_PLACE:
        return _place(problem, first, refit)
    return _searched(problem, name, first, refit)


PLACE_RANGE = (1e-3, 1e2)  # multiples of the present scatter of places to search between


def _place(problem: Problem, first: Solution, refit: Refit) -> tuple[Estimate, Solution]:
    """Return the scatter of places of the greatest restricted likelihood, with its profile.

    chi2 = dof would weigh points within a stay, which say nothing of places, as much as stays
    (Patterson and Thompson, Biometrika 58, 1971).
    """
    item, latest = problem.parameters[NOISE_PLACE], first
    low, high = (float(np.log(item.value * factor)) for factor in PLACE_RANGE)

    def loss(log_place: float) -> float:
        nonlocal latest
        latest = refit(float(np.exp(log_place)), latest)
        determinant = np.linalg.slogdet(latest.jacobian.T @ latest.jacobian)[1]
        value = 0.5 * (latest.chi2 + float(determinant))
        if latest.jacobian.shape[1] > len(latest.shape):
            return value  # the determinant of shape and draws holds that of V
        return value + problem.whitening(float(np.exp(log_place))).log_root_excess

    found = minimize_scalar(loss, bounds=(low, high), method="bounded", options={"xatol": 1e-4})
    best, least = float(found.x), float(found.fun)

    def end(limit: float, side: float) -> float:
        if loss(side) - least < 0.5 * limit:
            return 0.0 if side == low else item.upper
        a, b = sorted((side, best))
        return float(np.exp(brentq(lambda at: loss(at) - least - 0.5 * limit, a, b, xtol=1e-4)))

    value = float(np.exp(best))
    solution = refit(value, latest)
    one, two = (
        (end(q, low), end(q, high)) for q in (float(chdtri(1, 1.0 - p)) for p in PROBABILITIES)
    )
    sd = 0.5 * (one[1] - one[0])
    return Estimate(NOISE_PLACE, item.unit, value, sd, one, two), solution


def _scale(
    problem: Problem, first: Solution, refit: Refit, robust: bool
) -> tuple[Estimate, Solution]:
    """Return the scale in closed form, or by the median absolute residual under a robust loss."""
    item, dof = problem.parameters[NOISE_SCALE], float(problem.dof)
    value, solution = item.value, first
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
        factor = item.value / value if value > 0.0 else 1.0
        solution = replace(
            solution,
            rows=solution.rows * factor,
            jacobian=solution.jacobian * factor,
            cost=solution.cost * factor**2,
        )
    dof *= MAD_EFFICIENCY if robust else 1.0
    one, two = (
        (value * float(np.sqrt(dof / high)), value * float(np.sqrt(dof / low)))
        for low, high in chi2_limits(dof)
    )
    sd = value / float(np.sqrt(2.0 * dof))
    return Estimate(NOISE_SCALE, item.unit, value, sd, one, two), solution


def _searched(
    problem: Problem, name: str, first: Solution, refit: Refit
) -> tuple[Estimate, Solution]:
    item = problem.parameters[name]
    typical = float(np.sqrt(np.mean(problem.standard_error**2)))
    unit = 1.0 if name == NOISE_SCALE else typical
    lower = max(item.lower, 1e-3 * unit if name == NOISE_SCALE else 0.0)
    least, most = lower**2, min(item.upper, 1e9 * unit) ** 2
    latest = first

    def inverse(square: float) -> float:
        """Return 1 over chi2 at a squared noise: nearly a straight line, and never steeper."""
        nonlocal latest
        latest = refit(square**0.5, latest)
        return 1.0 / max(latest.chi2, 1e-300)

    def where(target: float, guess: float, tolerance: float) -> float:
        at, low, high = float(np.clip(guess**2, max(least, 1e-6 * unit**2), most)), least, most
        x, y = 0.0, 0.0
        for _ in range(MOST_STEPS):
            shown = inverse(at)
            over = target * shown - 1.0
            if (over >= 0.0 and at == least) or (over <= 0.0 and at == most):
                break
            low, high = (low, at) if over > 0.0 else (at, high)
            step = at - (shown - 1.0 / target) * ((at - x) / (shown - y) if shown != y else 0.0)
            x, y, before = at, shown, at
            at = float(np.clip(step, low, high))
            if abs(at - before) <= tolerance * max(before, 1e-6 * unit**2):
                break
        return float(np.sqrt(at))

    value = where(float(problem.dof), unit, 1e-9)
    solution = refit(value, latest)

    def end(limit: float) -> float:
        return where(limit, value * float(np.sqrt(problem.dof / limit)), 1e-6)

    ends = [(end(high), end(low)) for low, high in chi2_limits(problem.dof)]
    one, two = ((low, high) for low, high in ends)
    sd = 0.5 * (one[1] - one[0])
    hit = is_at_bound(replace(item, lower=lower), value, sd)
    return Estimate(name, item.unit, value, sd, one, two, hit), solution
