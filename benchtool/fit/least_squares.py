"""Weighted nonlinear least squares: values, covariance and intervals of a problem."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchtool.core.array import Array
from benchtool.core.errors import EstimationError, UnknownChoice
from benchtool.core.fit_result import Estimate, FitResult, Outcome
from benchtool.fit.interval import around, half_widths
from benchtool.fit.jacobian import Spread, spread_of
from benchtool.fit.noise import Noise, fit_noise
from benchtool.fit.problem import Problem
from benchtool.fit.solve import LOSSES, Loss, Solution, solve

SAME_COST = 1e-6
"""Two starts found the same minimum when their costs differ by less than this part."""

NORMAL_INFLATION: dict[Loss, float] = {"linear": 1.0, "soft_l1": 1.0790, "huber": 1.0526}
"""What a robust loss costs where no point is out of line: mean(psi^2) / mean(psi')^2 over the
normal distribution, integrated numerically. With stated errors the covariance is not less."""


def fit_least_squares(
    problem: Problem,
    *,
    loss: Loss = "linear",
    starts: int = 1,
    seed: int = 0,
    max_evaluations: int | None = None,
) -> FitResult:
    """Fit a problem by least squares.

    Stated standard errors are taken as they are: the covariance is (J^T J)^-1 and the intervals
    are normal. With `noise.scale` or `noise.sd` free the noise follows from chi2 and the intervals
    are Student's t. `chi2` of the result is always at the stated errors.

    Args:
        problem: what to fit.
        loss: "linear", or "soft_l1" and "huber" that count distant points less.
        starts: how many starting points; the first is the problem's own, the others are drawn.
        seed: of the other starting points.
        max_evaluations: of the prediction for each start; 200 for each parameter by default.
    """
    if loss not in LOSSES:
        raise UnknownChoice("loss", loss, LOSSES)
    sigma = problem.sigma()
    if not np.all(sigma > 0.0):
        raise EstimationError("the noise parameter starts at 0; start it above 0")
    solutions = _from_starts(problem, sigma, loss, starts, seed, max_evaluations)
    best = min(solutions, key=lambda solution: solution.cost)
    agreeing = sum(s.cost <= best.cost * (1.0 + SAME_COST) + 1e-12 for s in solutions)
    noise: Noise | None = None
    if problem.noise_name is not None:

        def refit(value: float, near: Solution) -> Solution:
            return solve(problem, problem.sigma(value), near.shape, loss=loss, way=near.way)

        noise = fit_noise(problem, best, refit, robust=loss != "linear")
        best = noise.solution
    spread = spread_of(best.jacobian, best.way)
    inflation = _robust_inflation(problem, best, loss)
    return _result(problem, best, spread, inflation, noise, loss, len(solutions), agreeing)


def _from_starts(
    problem: Problem,
    sigma: Array,
    loss: Loss,
    starts: int,
    seed: int,
    max_evaluations: int | None,
) -> list[Solution]:
    first = solve(problem, sigma, loss=loss, max_evaluations=max_evaluations)
    found = [first]
    rng = np.random.default_rng(seed)
    for start in _other_starts(problem, starts - 1, rng):
        try:
            found.append(
                solve(
                    problem, sigma, start, loss=loss, way=first.way, max_evaluations=max_evaluations
                )
            )
        except EstimationError:
            continue  # a drawn start where the model has no value: the others stand
    return found


def _other_starts(problem: Problem, count: int, rng: np.random.Generator) -> list[Array]:
    """Draw starts: within finite bounds evenly, else within a factor of three of the value."""
    lower, upper = problem.shape_bounds
    value = problem.start
    closed = np.isfinite(lower) & np.isfinite(upper)
    width = np.where(closed, upper, 0.0) - np.where(closed, lower, 0.0)
    drawn = []
    for _ in range(count):
        even = np.where(closed, lower, 0.0) + width * rng.random(len(value))
        near = value * 3.0 ** rng.uniform(-1.0, 1.0, len(value))
        drawn.append(np.clip(np.where(closed, even, near), lower, upper))
    return drawn


def _robust_inflation(problem: Problem, best: Solution, loss: Loss) -> float:
    """Return the factor on the covariance for the points that a robust loss counts less.

    mean(psi^2) / mean(psi')^2 of the weighted residuals (Huber, Robust Statistics, 1981, ch. 7).
    """
    if loss == "linear":
        return 1.0
    r = best.rows[: len(problem)]
    if loss == "soft_l1":
        root = np.sqrt(1.0 + r**2)
        psi, slope = r / root, 1.0 / root**3
    else:
        psi = np.clip(r, -1.345, 1.345)
        slope = (np.abs(r) <= 1.345).astype(float)
    left = max(len(problem) - len(problem.shape_names), 1)
    ratio = float(np.sum(psi**2) / left / max(float(np.mean(slope)), 1e-3) ** 2)
    return max(ratio, NORMAL_INFLATION[loss]) if problem.noise_name is None else ratio


def _result(
    problem: Problem,
    best: Solution,
    spread: Spread,
    inflation: float,
    noise: Noise | None,
    loss: Loss,
    starts: int,
    agreeing: int,
) -> FitResult:
    covariance = spread.covariance * inflation
    sd = np.sqrt(np.diag(covariance))
    widths = half_widths(None if noise is None else problem.dof)
    by_name = {
        name: around(name, problem.parameters[name], value, deviation, widths)
        for name, value, deviation in zip(problem.shape_names, best.shape, sd, strict=True)
    }
    if noise is not None:
        by_name[noise.estimate.name] = noise.estimate
    estimates = tuple(by_name[name] for name in problem.free_names)
    values = np.array([estimate.value for estimate in estimates])
    chi2, log_likelihood = problem.quality(values)
    undetermined = tuple(problem.shape_names[i] for i in spread.undetermined)
    return FitResult(
        method="least_squares",
        basis=problem.basis,
        model=problem.model,
        estimates=estimates,
        covariance=_with_noise(problem, covariance, noise),
        chi2=chi2,
        dof=problem.dof,
        log_likelihood=log_likelihood,
        outcome=_outcome(best, undetermined),
        warnings=(
            *_bound_warnings(problem, estimates),
            *_start_warnings(starts, agreeing),
        ),
        facts={
            **problem.facts,
            "points": len(problem),
            "prior_rows": len(problem.priors),
            "derivatives": best.way,
            "condition": spread.condition,
            "loss": loss,
            "starts": starts,
            "starts_agreeing": agreeing,
        },
    )


def _with_noise(problem: Problem, covariance: Array, noise: Noise | None) -> Array:
    if noise is None:
        return covariance
    n = len(problem.free_names)
    whole = np.zeros((n, n))
    whole[np.ix_(problem.shape_index, problem.shape_index)] = covariance
    position = problem.free_names.index(noise.estimate.name)
    whole[position, position] = noise.estimate.sd**2
    return whole


def _outcome(best: Solution, undetermined: Sequence[str]) -> Outcome:
    if undetermined:
        return Outcome(
            "stopped_early",
            f"these data do not determine {', '.join(undetermined)}; the values are one of many "
            f"that fit as well: fix some of them, state priors, or measure at other settings",
            best.evaluations,
        )
    if not best.finished:
        return Outcome(
            "stopped_early",
            f"the search used up its {best.evaluations} evaluations; start nearer to the answer "
            f"or allow more",
            best.evaluations,
        )
    return Outcome("converged", "a minimum was reached", best.evaluations)


def _bound_warnings(problem: Problem, estimates: Sequence[Estimate]) -> tuple[str, ...]:
    return tuple(
        f"{item.name} ended {item.bound} {item.value:g}{_unit(item)}; its intervals are cut there, "
        f"and other numbers lean on it: widen the bound or fix the parameter"
        for item in estimates
        if item.bound
    )


def _unit(item: Estimate) -> str:
    return "" if item.unit == "1" else f" {item.unit}"


def _start_warnings(starts: int, agreeing: int) -> tuple[str, ...]:
    if starts > 1 and agreeing == 1:
        return (f"only one of {starts} starting points reached the best minimum; try more of them",)
    return ()
