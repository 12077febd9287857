"""Weighted nonlinear least squares: values, noise, covariance and intervals of a problem.

Shape parameters and noise are solved alternately: the shape is refitted for each noise value until
chi2 = dof (Mandel and Paule, Anal. Chem. 42, 1970, for `noise.sd`; for `noise.scale` without
priors, unscaled sources or a fixed `noise.sd` this is the usual sqrt(chi2/dof) in one step). The
interval ends are the noise values at which chi2 equals its quantiles.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize_scalar
from scipy.special import chdtri

from benchtool.core.choices import Loss
from benchtool.core.error_source import Whitening, effective_dof
from benchtool.core.errors import EstimationError
from benchtool.core.fit_result import Estimate, FitResult, Outcome
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.fit.problem import NOISE_PLACE, NOISE_SCALE, Problem
from benchtool.fit.solve import Solution, estimate_covariance, row_jacobian, solve
from benchtool.fit.statistics import (
    MAD_EFFICIENCY,
    PROBABILITIES,
    chi2_limits,
    half_widths,
    interval_around,
    is_at_bound,
    robust_chi2,
    robust_inflation,
    robust_scale,
)

MAX_STEPS = 60  # of a search for the noise; four or five are usual
MAX_SEARCH_SDS = 64.0  # search range of a profile's end in standard deviations; beyond: the bound


def fit_least_squares(problem: Problem, *, loss: Loss = "linear") -> FitResult:
    """Fit a problem by least squares.

    With stated standard errors the covariance is (J^T J)^-1 and the intervals are normal. With
    `noise.scale` or `noise.sd` free the noise follows from chi2; then, or with shared errors of few
    degrees of freedom, the intervals are Student's t. `chi2` of the result is always at the stated
    errors; under a robust loss it is `robust_chi2`, which outliers do not influence.

    Args:
        loss: "linear", or "soft_l1" and "huber", which give outliers less weight. They apply to the
            residuals without shared errors.
    """
    if not np.all(problem.sigma() > 0.0):
        raise EstimationError("the initial noise parameter is 0; set it above 0")
    best = solve(problem, problem.whitening(), loss=loss)
    noise: Estimate | None = None
    if problem.noise_name is not None:
        noise, best = _fit_noise(problem, best, loss)
    m, n_shape, value = len(problem), len(best.shape), None if noise is None else noise.value
    whitening, jacobian, points_dof, factor = problem.whitening(value), best.jacobian, 0.0, 1.0
    if loss != "linear":
        points_dof = best.points_dof(m)
        inflation = robust_inflation(best.rows[:m], points_dof, loss, is_stated=noise is None)
        factor = float(np.sqrt(inflation))
        whitening, jacobian = problem.whitening(value, factor).independent, jacobian.copy()
        jacobian[:m] /= factor
    uncertainty = estimate_covariance(jacobian, best.method)
    covariance = uncertainty.covariance[:n_shape, :n_shape]
    sd = np.sqrt(np.diag(covariance))
    dof, growth = parameter_dof(problem, jacobian, uncertainty.covariance, whitening)
    by_name = {
        name: interval_around(
            name, problem.parameters[name], value, deviation, half_widths(float(parameter_nu))
        )
        for name, value, deviation, parameter_nu in zip(
            problem.shape_names, best.shape, sd * growth[:n_shape], dof[:n_shape], strict=True
        )
    }
    if noise is not None:
        by_name[noise.name] = noise
        position = problem.free_names.index(noise.name)
        covariance = np.insert(np.insert(covariance, position, 0.0, axis=0), position, 0.0, axis=1)
        covariance[position, position] = noise.sd**2
    estimates = tuple(by_name[name] for name in problem.free_names)
    values = np.array([estimate.value for estimate in estimates])
    chi2, log_likelihood = problem.quality(values)
    if loss != "linear":
        noise_ratio = problem.sigma(value) / problem.sigma(problem.stated_noise)
        chi2 = robust_chi2(best.rows[:m] * noise_ratio, points_dof)
    return FitResult(
        method="least_squares",
        basis=problem.basis,
        model=problem.model,
        estimates=estimates,
        covariance=covariance,
        chi2=chi2,
        dof=problem.dof if loss == "linear" else round(points_dof),
        log_likelihood=log_likelihood,
        outcome=_outcome(best, [problem.shape_names[i] for i in uncertainty.undetermined]),
        warnings=tuple(
            f"{estimate.name} ended {estimate.bound} "
            f"{f'{estimate.value:g} {estimate.unit}'.removesuffix(' 1')}; its intervals are "
            f"truncated, which biases other estimates: widen the bound or fix the parameter"
            for estimate in estimates
            if estimate.bound
        ),
        facts={
            **problem.facts,
            "points": len(problem),
            "prior_rows": len(problem.priors),
            "derivatives": best.method,
            "condition": uncertainty.condition,
            "loss": loss,
            "loss_factor": factor,
            "starts": 1,  # keys of result.json
            "starts_agreeing": 1,
        },
    )


def _outcome(best: Solution, undetermined: Sequence[str]) -> Outcome:
    if undetermined:
        return Outcome(
            "stopped_early",
            f"these data do not determine {', '.join(undetermined)}; other values fit equally "
            f"well: fix some of them, state priors, or measure at other settings",
            best.evaluations,
        )
    if not best.finished:
        return Outcome(
            "stopped_early",
            f"the limit of {best.evaluations} evaluations was reached; use better initial values "
            f"or allow more",
            best.evaluations,
        )
    return Outcome("converged", "a minimum was reached", best.evaluations)


def parameter_dof(
    problem: Problem, jacobian: Array, covariance: Array, whitening: Whitening
) -> tuple[Array, Array]:
    """Return effective degrees of freedom and a factor on standard deviations (n_shape,) each.

    Welch-Satterthwaite (GUM G.2b): points have the dof of a free noise parameter, shared errors and
    priors their own; inf for stated errors. Competing priors of few dof (two load cells calibrated
    with five masses each) are weighted by estimated variances, which the covariance neglects. The
    factor corrects this (Kackar and Harville, J. Am. Stat. Assoc. 79 (1984) 853; for a weighted
    mean Meier, Biometrics 9 (1953) 59); it is 1 for a prior without competitor.

    Args:
        jacobian: (m + q, n_shape) of the whitened rows.
        covariance: (n_shape, n_shape) from the Jacobian.
    """
    base = np.inf if problem.noise_name is None else float(problem.dof)
    sources = [s for s in problem.error_sources if np.isfinite(s.dof) and not s.scaled]
    priors = problem.priors
    groups = priors.estimated
    if not sources and not groups:
        return np.full(len(covariance), base), np.ones(len(covariance))
    finite = np.where(np.isfinite(covariance), covariance, 0.0)  # infinite: no interval
    m, gain = len(problem), finite @ jacobian.T
    sd = [np.linalg.norm(gain[:, :m] @ whitening(source.columns), axis=1) for source in sources]
    for row in (row for rows in groups for row in rows):
        sources += priors.parts[row]
        sd += [np.abs(gain[:, m + row]) * source.columns.item() for source in priors.parts[row]]
    remaining_sd = np.sqrt(np.maximum(np.diag(finite) - np.sum(np.square(sd), axis=0), 0.0))
    dof = np.array([*(source.dof for source in sources), base])
    scatters = [*(source.scatter for source in sources), ""]
    effective = [effective_dof(parts, dof, scatters) for parts in np.array([*sd, remaining_sd]).T]
    variance, growth = np.diag(finite), np.ones(len(finite))
    for rows in groups:
        gains = gain[:, m + rows]
        residual_covariance = np.eye(len(rows)) - jacobian[m + rows] @ gains
        excess = np.maximum(np.einsum("nq,qp,np->n", gains, residual_covariance, gains), 0.0)
        share = np.divide(excess, variance, np.zeros(len(finite)), where=variance > 0)
        growth += 4.0 / priors.dof[rows[0]] * share
    return np.array(effective), np.sqrt(growth)


def _fit_noise(problem: Problem, first: Solution, loss: Loss) -> tuple[Estimate, Solution]:
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
    if name == NOISE_SCALE and (loss != "linear" or is_one_factor):
        return _fit_scale(problem, first, loss)
    if name == NOISE_PLACE:
        return _fit_place(problem, first, loss)
    return _fit_by_search(problem, name, first, loss)


def _refit(problem: Problem, noise: float, near: Solution, loss: Loss) -> Solution:
    """Return the solution at a noise value, from one at another value."""
    return solve(problem, problem.whitening(noise), near.shape, loss=loss, method=near.method)


PLACE_RANGE = (1e-3, 1e2)  # search range, multiples of the initial position scatter


def _fit_place(problem: Problem, first: Solution, loss: Loss) -> tuple[Estimate, Solution]:
    """Return the plate position scatter of maximum restricted likelihood, with its profile.

    chi2 = dof would give points within a stay, which contain no information on position scatter,
    the same weight as stays (Patterson and Thompson, Biometrika 58, 1971).
    """
    parameter, latest = problem.parameters[NOISE_PLACE], first
    low, high = (float(np.log(parameter.value * factor)) for factor in PLACE_RANGE)

    def restricted_loss(log_place: float) -> float:
        nonlocal latest
        latest = _refit(problem, float(np.exp(log_place)), latest, loss)
        determinant = np.linalg.slogdet(latest.jacobian.T @ latest.jacobian)[1]
        value = 0.5 * (latest.chi2 + float(determinant))
        if latest.jacobian.shape[1] > len(latest.shape):
            return value  # the determinant of shape and shared errors contains that of V
        return value + problem.whitening(float(np.exp(log_place))).log_root_excess

    minimum = minimize_scalar(
        restricted_loss, bounds=(low, high), method="bounded", options={"xatol": 1e-4}
    )
    best_log, min_loss = float(minimum.x), float(minimum.fun)

    def rise(log_place: float, limit: float) -> float:
        return restricted_loss(log_place) - min_loss - 0.5 * limit

    def find_end(limit: float, side: float) -> float:
        if rise(side, limit) < 0.0:
            return 0.0 if side == low else parameter.upper
        a, b = sorted((side, best_log))
        return float(np.exp(brentq(rise, a, b, args=(limit,), xtol=1e-4)))

    value = float(np.exp(best_log))
    solution = _refit(problem, value, latest, loss)
    limits = (float(chdtri(1, 1.0 - p)) for p in PROBABILITIES)
    interval_68, interval_95 = ((find_end(q, low), find_end(q, high)) for q in limits)
    sd = 0.5 * (interval_68[1] - interval_68[0])
    return Estimate(NOISE_PLACE, parameter.unit, value, sd, interval_68, interval_95), solution


def _fit_scale(problem: Problem, first: Solution, loss: Loss) -> tuple[Estimate, Solution]:
    """Return the scale in closed form, or by the median absolute residual under a robust loss."""
    parameter, dof = problem.parameters[NOISE_SCALE], float(problem.dof)
    value, solution = parameter.value, first
    if is_robust := loss != "linear":
        for _ in range(20):
            dof = solution.points_dof(len(problem))
            factor = max(robust_scale(solution.rows[: len(problem)], dof), 1e-300)
            value *= factor
            solution = _refit(problem, value, solution, loss)
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
    dof *= MAD_EFFICIENCY if is_robust else 1.0
    interval_68, interval_95 = (
        (value * float(np.sqrt(dof / high)), value * float(np.sqrt(dof / low)))
        for low, high in chi2_limits(dof)
    )
    sd = value / float(np.sqrt(2.0 * dof))
    return Estimate(NOISE_SCALE, parameter.unit, value, sd, interval_68, interval_95), solution


def _fit_by_search(
    problem: Problem, name: str, first: Solution, loss: Loss
) -> tuple[Estimate, Solution]:
    parameter = problem.parameters[name]
    typical = float(np.sqrt(np.mean(problem.standard_error**2)))
    unit = 1.0 if name == NOISE_SCALE else typical
    lower = max(parameter.lower, 1e-3 * unit if name == NOISE_SCALE else 0.0)
    x_min, x_max = lower**2, min(parameter.upper, 1e9 * unit) ** 2
    latest = first

    def solve_noise(target: float, guess: float, tolerance: float) -> float:
        """Search by secants of y = 1 / chi2 at x, the squared noise: concave in x."""
        nonlocal latest
        x, low, high = float(np.clip(guess**2, max(x_min, 1e-6 * unit**2), x_max)), x_min, x_max
        x_0, y_0 = 0.0, 0.0
        for _ in range(MAX_STEPS):
            latest = _refit(problem, x**0.5, latest, loss)
            y = 1.0 / max(latest.chi2, 1e-300)
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
    solution = _refit(problem, value, latest, loss)

    def find_end(limit: float) -> float:
        return solve_noise(limit, value * float(np.sqrt(problem.dof / limit)), 1e-6)

    ends = [(find_end(high), find_end(low)) for low, high in chi2_limits(problem.dof)]
    interval_68, interval_95 = ((low, high) for low, high in ends)
    sd = 0.5 * (interval_68[1] - interval_68[0])
    bound = is_at_bound(replace(parameter, lower=lower), value, sd)
    return Estimate(name, parameter.unit, value, sd, interval_68, interval_95, bound), solution


def add_profile_intervals(problem: Problem, result: FitResult) -> FitResult:
    """Return a least-squares result of linear loss with profile-likelihood intervals.

    For models whose covariance at the minimum is misleading. At an interval end the minimum
    chi-square over all other parameters has increased by the square of the half width in standard
    deviations.
    """
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
    method: Any = result.facts["derivatives"]
    position = problem.shape_names.index(estimate.name)
    parameter = problem.parameters[estimate.name]

    def find_end(side: float, width: float) -> float:
        others = np.delete(shape, position)

        def rise(value: float) -> float:
            nonlocal others
            if len(shape) == 1:
                rows = problem.rows(np.array([value]), whitening)
                return float(rows @ rows) - min_chi2 - width**2
            solution = solve(problem.fixed(estimate.name, value), whitening, others, method=method)
            others = solution.shape
            return solution.chi2 - min_chi2 - width**2

        bound = parameter.upper if side > 0 else parameter.lower
        near, reach = estimate.value, 0.7 * width
        while reach < MAX_SEARCH_SDS * width:
            far = estimate.value + side * reach * estimate.sd
            stopped = side * (far - bound) >= 0.0
            far = bound if stopped else far
            if rise(far) > 0.0:
                return float(brentq(rise, near, far, xtol=1e-5 * estimate.sd))
            if stopped:
                break
            near, reach = far, 1.6 * reach
        return float(bound)

    jacobian = row_jacobian(problem, method, shape, whitening)
    covariance = estimate_covariance(jacobian, method).covariance
    dof, growth = parameter_dof(problem, jacobian, covariance, whitening)
    widths = [float(growth[position]) * width for width in half_widths(float(dof[position]))]
    interval_68, interval_95 = ((find_end(-1.0, width), find_end(1.0, width)) for width in widths)
    return replace(estimate, interval_68=interval_68, interval_95=interval_95)
