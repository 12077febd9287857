"""Cross-validation of models."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from benchtool.core.errors import EstimationError, InputError
from benchtool.core.fit_result import FitResult
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.problem import IntArray, Problem, normal_log_density
from benchtool.fit.solve import derivative_method, prediction_jacobian


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """Cross-validation score of one model; held-out scores are nan if a training fit failed."""

    model: str  # its name
    held_out_log_score: float  # mean log density of held-out points, larger is better
    held_out_log_score_se: float  # its standard error over settings
    behind_best: float  # sum over points of log density lost against the best model
    behind_best_se: float  # its standard error over settings
    held_out_rms: float  # of held-out residuals, in the unit of the observations
    aic: float  # of the fit to all points (Akaike 1974)
    bic: float  # of the fit to all points (Schwarz 1978)
    chi2_per_dof: float  # of the fit to all points
    parameters: int  # number of free parameters

    @property
    def is_clearly_behind(self) -> bool:
        """True if the loss against the best exceeds twice its standard error."""
        return self.behind_best > 2.0 * self.behind_best_se


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Cross-validation scores of all models, best first."""

    folds: int  # number of folds
    settings: int  # number of settings
    seed: int  # of the folds
    scores: tuple[Score, ...]  # (k,)

    @property
    def sentence(self) -> str:
        """Return one sentence that compares the best model with the others."""
        best, *others = self.scores
        sentence = f"{best.model} predicts held-out points best"
        if not others:
            return sentence
        parts = [
            f"{score.model} is {'clearly' if score.is_clearly_behind else 'not clearly'} behind "
            f"({score.behind_best:.1f} ± {score.behind_best_se:.1f} in log score)"
            for score in others
        ]
        return f"{sentence}; {'; '.join(parts)}"


def compare(problems: Sequence[Problem], *, folds: int = 5, seed: int = 1) -> Comparison:
    """Return cross-validation scores of problems of the same points, one for each model.

    Points of one setting are held out together (`Problem.groups`), so that repeats of a point are
    not in the training set. The predictive variance of a held-out point contains its standard error
    (with the fitted noise) and the uncertainty of the fitted parameters. The density is conditional
    on the training residuals, because points share errors (a reference, a zero): a sum of marginal
    log densities would count a shared error once for every point.
    """
    if not problems:
        raise InputError("no model to compare; name at least one")
    first = problems[0]
    for problem in problems[1:]:
        if not np.array_equal(problem.observed, first.observed):
            raise InputError(
                f"models {first.model!r} and {problem.model!r} have different points; "
                f"use the same row selection for both"
            )
    groups = np.arange(len(first)) if first.groups is None else first.groups
    settings = np.unique(groups)
    if len(settings) < 3:
        raise InputError(
            f"{pluralize(len(settings), 'setting')} are too few for cross-validation; minimum: 3; "
            f"measure at more plate distances or compare by chi2"
        )
    count = min(folds, len(settings))
    fold_of_setting = np.random.default_rng(seed).permutation(np.arange(len(settings)) % count)
    fold = fold_of_setting[np.searchsorted(settings, groups)]
    held_out = [_held_out(problem, fold, count) for problem in problems]
    sums = [density.sum() if np.all(np.isfinite(density)) else -np.inf for density, _ in held_out]
    best = int(np.argmax(sums))
    scores = [
        _score(problem, density, residuals, held_out[best][0], groups)
        for problem, (density, residuals) in zip(problems, held_out, strict=True)
    ]
    order = np.argsort([-log_score for log_score in sums], kind="stable")
    return Comparison(count, len(settings), seed, tuple(scores[index] for index in order))


def _held_out(problem: Problem, fold: IntArray, count: int) -> tuple[Array, Array]:
    """Return log density and residual (m,) of every point as a held-out point."""
    density, residuals = np.full(len(problem), np.nan), np.full(len(problem), np.nan)
    for fold_number in range(count):
        test = np.flatnonzero(fold == fold_number)
        with suppress(EstimationError):
            density[test], residuals[test] = hold_out(problem, test)
    return density, residuals


def hold_out(problem: Problem, test: IntArray) -> tuple[Array, Array]:
    """Return predictive log density and residual (k,) of points for a fit to all others."""
    training = problem.subset(np.setdiff1d(np.arange(len(problem)), test))
    return predictive_density(problem.subset(test), training, fit_least_squares(training))


def predictive_density(
    problem: Problem, training: Problem, result: FitResult
) -> tuple[Array, Array]:
    """Return predictive log density and residual (m,) of points for a fit to training points.

    Both are conditional on the training points (Rasmussen and Williams, Gaussian Processes for
    Machine Learning, 2006, eqs. 2.38 and 2.42; the shared errors take the place of the process).
    """
    shape, noise = problem.split(result.values)
    # The gain matrix maps whitened training residuals to the shared errors at these points.
    whitening = training.whitening(noise)
    whitened_shared = whitening(training.shared(noise))
    shared = problem.shared(noise)
    gain = shared @ whitened_shared.T
    training_rows = whitening(training.residuals(result.values))
    residuals = problem.residuals(result.values) - gain @ training_rows
    with np.errstate(all="ignore"):
        method = derivative_method(problem, shape)
        training_slopes = whitening(prediction_jacobian(training, method, shape))
        slopes = prediction_jacobian(problem, method, shape) - gain @ training_slopes
    shared_variance = np.maximum(np.sum(shared**2, axis=1) - np.sum(gain**2, axis=1), 0.0)
    error_variance = problem.sigma(noise) ** 2 + shared_variance
    covariance = result.covariance[np.ix_(problem.shape_index, problem.shape_index)]
    is_open = ~np.isfinite(np.diag(covariance))
    # A parameter that the training set does not determine gets a wide variance: it has no
    # influence on points where its slope is 0 and widens the density of all others.
    covariance = np.where(np.outer(is_open, is_open) & np.isinf(covariance), 0.0, covariance)
    for i in np.flatnonzero(is_open):
        covariance[i, i] = max(shape[i] ** 2, 1.0)
    parameter_variance = np.einsum("mi,ij,mj->m", slopes, covariance, slopes)
    sd = np.sqrt(error_variance + np.maximum(parameter_variance, 0.0))
    return normal_log_density(residuals / sd, sd), residuals


def _score(
    problem: Problem, density: Array, residuals: Array, best_density: Array, groups: IntArray
) -> Score:
    result = fit_least_squares(problem)
    n_free, n_points = len(problem.free_names), len(problem)
    losses = _by_setting(best_density - density, groups)
    log_scores = _by_setting(density, groups)
    settings = len(log_scores)
    return Score(
        model=problem.model,
        held_out_log_score=float(density.sum() / n_points),
        held_out_log_score_se=float(np.sqrt(settings) * log_scores.std(ddof=1) / n_points),
        behind_best=float(losses.sum()),
        behind_best_se=float(np.sqrt(settings) * losses.std(ddof=1)),
        held_out_rms=float(np.sqrt(np.mean(residuals**2))),
        aic=2.0 * n_free - 2.0 * result.log_likelihood,
        bic=n_free * float(np.log(n_points)) - 2.0 * result.log_likelihood,
        chi2_per_dof=result.chi2_per_dof,
        parameters=n_free,
    )


def _by_setting(values: Array, groups: IntArray) -> Array:
    """Return sums of values (m,) over each setting (k,)."""
    _, index = np.unique(groups, return_inverse=True)
    return np.bincount(index, values).astype(float)
