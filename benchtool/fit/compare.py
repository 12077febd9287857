"""Compare models by how well they predict points that they were not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.error_source import Whitening
from benchtool.core.errors import EstimationError, InputError
from benchtool.core.fit_result import FitResult
from benchtool.core.plural import pluralize
from benchtool.fit.jacobian import Way, select_method
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.problem import IntArray, Problem, normal_log_density
from benchtool.fit.solve import row_jacobian


@dataclass(frozen=True, slots=True, eq=False)
class Score:
    """Hold how one model did.

    Attributes:
        held_out_log_score: mean log density of held-out points, larger is better; nan when a
            training set could not be fitted.
        aic, bic: of the fit to all points (Akaike 1974; Schwarz 1978).
    """

    model: str  # its name
    held_out_log_score: float
    held_out_log_score_se: float  # its standard error over settings
    behind_best: float  # sum over points of log density lost against the best model
    behind_best_se: float  # its standard error over settings
    held_out_rms: float  # of held-out residuals, in the unit of what was observed
    aic: float
    bic: float
    chi2_per_dof: float  # of the fit to all points
    parameters: int  # how many are free

    @property
    def clearly_behind(self) -> bool:
        """Whether the loss against the best is more than twice its standard error."""
        return self.behind_best > 2.0 * self.behind_best_se


@dataclass(frozen=True, slots=True, eq=False)
class Comparison:
    """Hold the scores of all models, the best first, and what was held out."""

    scores: tuple[Score, ...]  # (k,)
    folds: int  # how many
    settings: int  # how many settings the points fall into
    seed: int  # of the folds

    @property
    def sentence(self) -> str:
        """Say which model predicts best, and whether the next is clearly behind."""
        best, *others = self.scores
        sentence = f"{best.model} predicts held-out points best"
        if not others:
            return sentence
        parts = [
            f"{score.model} is {'clearly' if score.clearly_behind else 'not clearly'} behind "
            f"({score.behind_best:.1f} ± {score.behind_best_se:.1f} in log score)"
            for score in others
        ]
        return f"{sentence}; {'; '.join(parts)}"


def compare(problems: Sequence[Problem], *, folds: int = 5, seed: int = 1) -> Comparison:
    """Fit each problem to all folds but one and score the one, for every fold.

    Points of one setting are held out together (`Problem.groups`), so that repeats of a point do
    not show a model what it should predict. The density of a held-out point carries its standard
    error (with the fitted noise) and the uncertainty of the fitted parameters. It is conditional on
    the training points: what their residuals say of errors that they share with it (a reference, a
    zero) is taken off, with what they leave open. The marginal density would count one such error
    again at every point, and a sum of those is no model's probability of anything.

    Args:
        problems: of the same points, one for each model.
    """
    if not problems:
        raise InputError("there is no model to compare; give at least one")
    first = problems[0]
    for problem in problems[1:]:
        if not np.array_equal(problem.observed, first.observed):
            raise InputError(
                f"models {first.model!r} and {problem.model!r} were not given the same points; "
                f"compare them on one selection"
            )
    groups = np.arange(len(first)) if first.groups is None else first.groups
    settings = np.unique(groups)
    if len(settings) < 3:
        raise InputError(
            f"points fall into {pluralize(len(settings), 'setting')}, holding out needs 3; "
            f"measure at more plate distances or compare by chi2"
        )
    count = min(folds, len(settings))
    fold_of_setting = np.random.default_rng(seed).permutation(np.arange(len(settings)) % count)
    fold = fold_of_setting[np.searchsorted(settings, groups)]
    held_out = [_held_out(problem, fold, count) for problem in problems]
    sums = [density.sum() if np.all(np.isfinite(density)) else -np.inf for density, _ in held_out]
    best = int(np.argmax(sums))
    scores = [
        _score(problem, density, left, held_out[best][0], groups)
        for problem, (density, left) in zip(problems, held_out, strict=True)
    ]
    order = np.argsort([-s for s in sums], kind="stable")
    return Comparison(tuple(scores[i] for i in order), count, len(settings), seed)


def _held_out(problem: Problem, fold: IntArray, count: int) -> tuple[Array, Array]:
    """Return log density and residual (m,) of every point when it was held out."""
    density, left = np.full(len(problem), np.nan), np.full(len(problem), np.nan)
    for number in range(count):
        test = np.flatnonzero(fold == number)
        training = problem.subset(np.flatnonzero(fold != number))
        try:
            result = fit_least_squares(training)
        except EstimationError:
            continue
        density[test], left[test] = predicted(problem.subset(test), training, result)
    return density, left


def predicted(problem: Problem, training: Problem, result: FitResult) -> tuple[Array, Array]:
    """Return log density and residual (m,) of points under a result fitted to the training points.

    Both are conditional on the training points (Rasmussen and Williams, Gaussian Processes for
    Machine Learning, 2006, eqs. 2.38 and 2.42 with the draws that points share in place of a
    process).
    """
    shape, noise = problem.split(result.values)
    lower, upper = problem.shape_bounds
    # One matrix takes training rows to what they say of the shared draws at these points.
    whitening = training.whitening(noise)
    known = whitening(training.shared(noise))
    shared = problem.shared(noise)
    pull = shared @ known.T
    left = problem.residuals(result.values) - pull @ whitening(training.residuals(result.values))
    with np.errstate(all="ignore"):
        way = select_method(problem.predict, shape, len(problem), lower, upper)
        slopes = _slopes(problem, way, shape) - pull @ whitening(_slopes(training, way, shape))
    own = problem.sigma(noise) ** 2
    own = own + np.maximum(np.sum(shared**2, axis=1) - np.sum(pull**2, axis=1), 0.0)
    covariance = result.covariance[np.ix_(problem.shape_index, problem.shape_index)]
    open_ones = ~np.isfinite(np.diag(covariance))
    # A parameter that training left open says nothing of points where it does not act; where it
    # does act, the point cannot be predicted, and a wide density says so.
    covariance = np.where(np.outer(open_ones, open_ones) & np.isinf(covariance), 0.0, covariance)
    for i in np.flatnonzero(open_ones):
        covariance[i, i] = max(shape[i] ** 2, 1.0)
    variance = np.einsum("mi,ij,mj->m", slopes, covariance, slopes)
    sd = np.sqrt(own + np.maximum(variance, 0.0))
    return normal_log_density(left / sd, sd), left


def _slopes(problem: Problem, way: Way, shape: Array) -> Array:
    """Return d prediction / d shape (m, n_shape)."""
    m = len(problem)
    plain = Whitening(np.ones(m), np.empty((m, 0)))
    return row_jacobian(problem, way)(shape, plain)[:m]


def _score(
    problem: Problem, density: Array, left: Array, best_density: Array, groups: IntArray
) -> Score:
    whole = fit_least_squares(problem)
    n, m = len(problem.free_names), len(problem)
    lost = _by_setting(best_density - density, groups)
    own = _by_setting(density, groups)
    settings = len(own)
    return Score(
        model=problem.model,
        held_out_log_score=float(density.sum() / m),
        held_out_log_score_se=float(np.sqrt(settings) * own.std(ddof=1) / m),
        behind_best=float(lost.sum()),
        behind_best_se=float(np.sqrt(settings) * lost.std(ddof=1)),
        held_out_rms=float(np.sqrt(np.mean(left**2))),
        aic=2.0 * n - 2.0 * whole.log_likelihood,
        bic=n * float(np.log(m)) - 2.0 * whole.log_likelihood,
        chi2_per_dof=whole.chi2_per_dof,
        parameters=n,
    )


def _by_setting(values: Array, groups: IntArray) -> Array:
    """Return sums of values (m,) over each setting (k,)."""
    _, place = np.unique(groups, return_inverse=True)
    return np.bincount(place, values).astype(float)
