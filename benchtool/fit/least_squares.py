"""Weighted nonlinear least squares: values, covariance and intervals of a problem."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchtool.core.choices import Loss
from benchtool.core.errors import EstimationError, UnknownChoice
from benchtool.core.fit_result import Estimate, FitResult, Outcome
from benchtool.fit.interval import half_widths, interval_around
from benchtool.fit.jacobian import estimate_covariance
from benchtool.fit.noise import fit_noise
from benchtool.fit.problem import Problem
from benchtool.fit.robust import LOSSES, robust_chi2, robust_inflation
from benchtool.fit.solve import Solution, solve
from benchtool.fit.uncertainty.parameter_dof import parameter_dof


def fit_least_squares(
    problem: Problem, *, loss: Loss = "linear", max_evaluations: int | None = None
) -> FitResult:
    """Fit a problem by least squares.

    With stated standard errors the covariance is (J^T J)^-1 and the intervals are normal. With
    `noise.scale` or `noise.sd` free the noise follows from chi2; then, or with shared errors of few
    degrees of freedom, the intervals are Student's t. `chi2` of the result is always at the stated
    errors; under a robust loss it is `robust_chi2`, which outliers do not influence.

    Args:
        loss: "linear", or "soft_l1" and "huber", which give outliers less weight. They apply to the
            residuals without shared errors.
        max_evaluations: of the prediction; 200 for each parameter by default.
    """
    if loss not in LOSSES:
        raise UnknownChoice("loss", loss, LOSSES)
    if not np.all(problem.sigma() > 0.0):
        raise EstimationError("the initial noise parameter is 0; set it above 0")
    best = solve(problem, problem.whitening(), loss=loss, max_evaluations=max_evaluations)
    noise: Estimate | None = None
    if problem.noise_name is not None:

        def refit(value: float, near: Solution) -> Solution:
            whitening = problem.whitening(value)
            return solve(problem, whitening, near.shape, loss=loss, method=near.method)

        noise, best = fit_noise(problem, best, refit, robust=loss != "linear")
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
        n = len(problem.free_names)
        whole = np.zeros((n, n))
        whole[np.ix_(problem.shape_index, problem.shape_index)] = covariance
        position = problem.free_names.index(noise.name)
        whole[position, position] = noise.sd**2
        covariance = whole
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
