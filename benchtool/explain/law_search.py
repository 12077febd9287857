"""Search for the variable and the simplest law of an unnamed effect.

Residuals z of one channel have a precision Q that includes everything within tolerance. A column c
of a law gains (c b)^2 / (c Q c + 1/s^2) with b = Q z, so thousands of laws cost one matrix product.
Prior probabilities sum to 1 over all variables, forms, families and shapes, which corrects for
multiple comparisons. The mean likelihood over its shapes penalises a law with more parameters.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.explain.laws import (
    FAMILIES,
    FoundDependence,
    Law,
    LawCurve,
    LawFamily,
    LawForm,
    Variable,
)

PRIOR_SD = 0.03  # of a law's rms change, relative to the weights; assumed
MIN_LOG_ODDS = 5.0  # of a dependence over none, corrected for multiple comparisons
MIN_GAIN = 0.3  # share of the held-out gap that a drafted law closes at least
FOLDS = 10  # of the cross-validation
CORRELATION_LENGTH = 0.3  # of a smooth function, in shares of the variable's range; assumed
REFINEMENTS = 10  # of the shape of a law
SMOOTH_SIZES = (0.01, 0.04)  # sd of smooth functions, relative to the weights


@dataclass(frozen=True, slots=True, eq=False)
class QuadraticSummary:
    """Chi-squared of readings z about f (m,): f Q f - 2 f Q z + z Q z, a quadratic form."""

    precision: Array  # Q (m, m)
    pull: Array  # Q z (m,)
    square: float  # z Q z

    def __sub__(self, other: QuadraticSummary) -> QuadraticSummary:
        precision, pull = self.precision - other.precision, self.pull - other.pull
        return QuadraticSummary(precision, pull, self.square - other.square)

    def without(self, out: NDArray[np.bool_]) -> QuadraticSummary:
        """Return the summary without some readings, by mask (m,)."""
        rows = np.column_stack([self.precision[out], self.pull[out]])
        removed = rows.T @ np.linalg.solve(self.precision[np.ix_(out, out)], rows)
        precision, pull = self.precision - removed[:-1, :-1], self.pull - removed[:-1, -1]
        return QuadraticSummary(precision, pull, self.square - float(removed[-1, -1]))


@dataclass(frozen=True, slots=True, eq=False)
class CrossValidationFold:
    """Summaries of the training readings of a fold."""

    training: QuadraticSummary  # as `ResidualSummary.quadratic`
    bare_training: QuadraticSummary  # as `ResidualSummary.bare_quadratic`
    noise: float  # expected sum of squares of the held-out readings from noise alone


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ResidualSummary:
    """Residuals as a function of a variable."""

    variable: Variable
    form: LawForm
    quadratic: QuadraticSummary  # its precision includes everything within tolerance
    bare_quadratic: QuadraticSummary  # the same without discrepancies
    folds: Sequence[CrossValidationFold]  # equal for all variables


@dataclass(frozen=True, slots=True, eq=False)
class _Shapes:
    """Shapes of one family for a variable and a form."""

    summary: ResidualSummary
    family: LawFamily
    numbers: Array  # (n, n_shapes)
    columns: Array  # (m, n_shapes)
    gains: Array  # (n_shapes,) log Bayes factors


def find_dependence(
    summaries: Sequence[ResidualSummary], radius_m: float
) -> FoundDependence | None:
    """Return the variable on which the residuals depend, with its law; None if improbable."""
    summaries = [s for s in summaries if np.ptp(s.form.affected_values(s.variable)) > 1e-6]
    families = [_try_families(summary) for summary in summaries]
    pairs = zip(summaries, families, strict=True)
    odds = np.array([_log_bayes_factor(summary, shapes) for summary, shapes in pairs])
    odds -= np.log(max(len(summaries), 1))
    if not len(odds) or odds.max() < MIN_LOG_ODDS:
        return None
    probabilities = np.asarray(np.exp(odds - np.logaddexp.reduce(odds)), float)
    phrases = np.array([summary.variable.phrase for summary in summaries])
    by_variable = {name: float(np.sum(probabilities[phrases == name])) for name in phrases}
    best = max(by_variable, key=lambda name: by_variable[name])
    index = int(np.argmax(np.where(phrases == best, odds, -np.inf)))
    summary, law, closed = summaries[index], None, 0.0
    if families[index]:
        closed = _cross_validate([shapes for group in families for shapes in group])
        if closed > MIN_GAIN:
            law = _refine_law(max(families[index], key=lambda shapes: _log_mean(shapes.gains)))
    return FoundDependence(
        variable=summary.variable,
        form=summary.form,
        probability=by_variable[best],
        candidates=len(summaries),
        law=law,
        closed=closed,
        curve=_build_curve(summary, law),
        radius_m=radius_m,
    )


def _try_families(summary: ResidualSummary) -> list[_Shapes]:
    variable, form = summary.variable, summary.form
    if not (variable.code and form.hook):
        return []
    values = form.affected_values(variable)
    suitable = [family for family in FAMILIES if variable.scale in family.scales]
    tried = [_shapes(summary, family, family.grid(values)) for family in suitable]
    return [shapes for shapes in tried if shapes.columns.shape[1]]


def _shapes(summary: ResidualSummary, family: LawFamily, numbers: Array) -> _Shapes:
    """Return the shapes of a family for numbers (n, n_shapes), without those of no effect."""
    variable, form = summary.variable, summary.form
    positive = [name in ("width", "length") for name in family.numbers]
    is_valid = np.all(numbers[positive] > 0.0, axis=0)
    numbers = numbers[:, is_valid]
    columns = form.weights[:, None] * _centre(form, family(variable.values, numbers))
    scale = np.sqrt(np.mean(columns**2, axis=0) / np.mean(form.weights**2))
    has_effect = scale > 1e-9
    columns = columns[:, has_effect] / scale[has_effect]
    return _Shapes(
        summary, family, numbers[:, has_effect], columns, _gains(summary.quadratic, columns)
    )


def _centre(form: LawForm, law: Array) -> Array:
    """Return a law's values (m, n), without their mean for a centred form.

    The mean of a form near the plate is equivalent to a law of distance, else to a different thrust
    coefficient.
    """
    if not form.centred:
        return law
    mean: Array = np.average(law, axis=0, weights=form.weights**2)
    return law - mean


def _log_bayes_factor(summary: ResidualSummary, tried: Sequence[_Shapes]) -> float:
    """Return the log Bayes factor of a dependence over none, from laws and smooth functions."""
    variable, form = summary.variable, summary.form
    columns = form.weights[:, None] * _centre(form, root(variable, form))
    factors = [_smooth_factor(summary.quadratic, size * columns) for size in SMOOTH_SIZES]
    smooth = _log_mean(np.array(factors))
    return _log_mean(np.array([smooth, *(_log_mean(shapes.gains) for shapes in tried)]))


def _log_mean(logarithms: Array) -> float:
    """Return the log of the mean of values with the given logarithms (n,)."""
    return float(np.logaddexp.reduce(logarithms)) - float(np.log(len(logarithms)))


def _smooth_factor(summary: QuadraticSummary, columns: Array) -> float:
    inner = np.eye(columns.shape[1]) + columns.T @ summary.precision @ columns
    pull = columns.T @ summary.pull
    return float(0.5 * pull @ np.linalg.solve(inner, pull) - 0.5 * np.linalg.slogdet(inner)[1])


def _gains(summary: QuadraticSummary, columns: Array) -> Array:
    """Return log Bayes factors of columns with a normal prior of the amplitude."""
    pull = columns.T @ summary.pull
    weight = np.sum(columns * (summary.precision @ columns), axis=0)
    gains: Array = 0.5 * pull**2 / (weight + PRIOR_SD**-2) - 0.5 * np.log1p(PRIOR_SD**2 * weight)
    return gains


def root(variable: Variable, form: LawForm, more: Array | None = None) -> Array:
    """Return the root of the covariance of a smooth function of a variable (m + n_more, r).

    Over the logarithm of variables well above 0.
    """
    values = variable.values if more is None else np.concatenate([variable.values, more])
    if variable.is_categorical:
        result: Array = (values[:, None] == np.unique(values)).astype(float)
        return result
    affected = form.affected_values(variable)
    values = np.clip(values, affected.min(), affected.max())
    if _is_logarithmic(variable, affected):
        values, affected = np.log(values), np.log(affected)
    unique, rows = np.unique(np.round(values / np.ptp(affected), 2), return_inverse=True)
    squares = ((unique[:, None] - unique) / CORRELATION_LENGTH) ** 2
    size, axes = np.linalg.eigh(np.exp(-0.5 * squares))
    is_kept = size > 1e-6 * size[-1]
    smooth: Array = (axes[:, is_kept] * np.sqrt(size[is_kept]))[rows.reshape(-1)]
    return smooth


def _is_logarithmic(variable: Variable, values: Array) -> bool:
    return variable.scale in ("positive", "distance") and bool(values.min() > 0.02 * values.max())


def _cross_validate(candidates: Sequence[_Shapes]) -> float:
    """Return the share of the held-out gap that the best law of each fold closes."""
    before = after = noise = 0.0
    for number in range(len(candidates[0].summary.folds)):
        gains = [_gains(c.summary.folds[number].training, c.columns) for c in candidates]
        best = max(range(len(candidates)), key=lambda k: _log_mean(gains[k]))
        law = candidates[best].columns[:, int(np.argmax(gains[best]))]
        summary = candidates[best].summary
        fold = summary.folds[number]
        training, held_out = fold.bare_training, summary.bare_quadratic - fold.bare_training
        a = float(law @ training.pull / (law @ training.precision @ law + PRIOR_SD**-2))
        before += held_out.square
        after += held_out.square - 2.0 * a * float(law @ held_out.pull)
        after += a * a * float(law @ held_out.precision @ law)
        noise += fold.noise
    return float(np.clip((before - after) / max(before - noise, 1e-9), 0.0, 1.0))


def _refine_law(shapes: _Shapes) -> Law:
    """Return the best law of a family, with parameters refined from the best shape tried."""
    summary, quadratic = shapes.summary, shapes.summary.quadratic
    u, weights = summary.variable.values, summary.form.weights
    numbers = shapes.numbers[:, int(np.argmax(shapes.gains))]
    if len(numbers) and shapes.family.name != "line":
        axes = [0.4 * np.array([-1.0, -0.5, 0.0, 0.5, 1.0])] * len(numbers)
        grid = np.array(np.meshgrid(*axes)).reshape(len(numbers), -1)
        scale = np.maximum(np.abs(numbers), 0.05)
        for refinement in range(REFINEMENTS):
            tried = numbers[:, None] + scale[:, None] * grid * 0.7**refinement
            refined = _shapes(summary, shapes.family, tried)
            numbers = refined.numbers[:, int(np.argmax(refined.gains))]
    steps = 0.02 * np.maximum(np.abs(numbers), 0.02)
    columns = [weights * shapes.family(u, numbers)]
    weight = columns[0] @ quadratic.precision @ columns[0]
    amplitude = float(columns[0] @ quadratic.pull / weight)
    for k, step in enumerate(steps):
        changed = numbers + step * np.eye(len(numbers))[k]
        columns.append(amplitude * (weights * shapes.family(u, changed) - columns[0]) / step)
    slopes = np.stack(columns, axis=1)
    curvature = slopes.T @ quadratic.precision @ slopes
    sd = np.sqrt(np.diag(np.linalg.pinv(curvature)))
    return Law(
        family=shapes.family,
        amplitude=amplitude,
        numbers=tuple(float(value) for value in numbers),
        sds=tuple(float(value) for value in sd[1:]),
    )


def _build_curve(summary: ResidualSummary, law: Law | None) -> LawCurve:
    """Return the smooth function of the variable fitted to the residuals, with the law."""
    variable, form, quadratic = summary.variable, summary.form, summary.quadratic
    affected = form.affected_values(variable)
    space = np.geomspace if _is_logarithmic(variable, affected) else np.linspace
    at = np.asarray(space(affected.min(), affected.max(), 80), float)
    m = len(variable.values)
    both = max(SMOOTH_SIZES) * root(variable, form, None if variable.is_categorical else at)
    columns = form.weights[:, None] * both[:m]
    precision = np.eye(both.shape[1]) + columns.T @ quadratic.precision @ columns
    covariance = np.linalg.inv(precision)
    coefficients = covariance @ (columns.T @ quadratic.pull)
    if variable.is_categorical:
        at, smooth = variable.values, both
    else:
        smooth = both[m:]
    mean = smooth @ coefficients
    sd = np.sqrt(np.sum((smooth @ covariance) * smooth, axis=1))
    weights = np.diag(quadratic.precision)
    is_shown = np.abs(form.weights) > 0.05 * np.abs(form.weights).max()
    is_shown &= weights > 1e-9 * weights.max()
    # Residual of each reading from the smooth function, by its own precision.
    residuals = quadratic.pull - quadratic.precision @ (columns @ coefficients)
    residuals = residuals / np.where(is_shown, weights, 1.0)
    shares = both[:m][is_shown] @ coefficients + residuals[is_shown] / form.weights[is_shown]
    law_values = np.empty(0) if law is None else law.amplitude * law.family(at, law.numbers)
    return LawCurve(
        at=at, mean=mean, low=mean - 1.96 * sd, high=mean + 1.96 * sd, law=law_values,
        points=variable.values[is_shown], shares=shares,
    )  # fmt: skip
