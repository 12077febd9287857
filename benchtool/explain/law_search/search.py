"""Search for what readings depend on that no hypothesis explains, and for the shortest law of it.

Readings z of one channel miss the model by more than it allows. All that may vary within tolerance
is in their precision Q, so that a column c of a law gains (c b)^2 / (c Q c + 1/s^2) with b = Q z:
thousands of laws cost one product of matrices. Every variable, form, family and shape has a prior
probability that sums to 1 over all, which is what the look around costs; a law with more numbers
pays for them by the mean of its likelihood over its shapes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.explain.law_search.families import FAMILIES, LawFamily
from benchtool.explain.law_search.law import FoundDependence, Law, LawCurve, LawForm, Variable

SIZE = 0.03  # standard deviation of what a law changes, root mean square over the weights; assumed
MIN_PROBABILITY = 5.0  # least log odds of a dependence over none, the look around paid for
MIN_GAIN = 0.3  # least share of the held-out gap that a law closes to be drafted
FOLDS = 10  # parts of the readings that are held out in turn
BENDS = 0.3  # part of a variable's range over which a smooth function of it may change; assumed
ZOOMS = 10  # rounds in which the shape of a law is refined
SMOOTH = (0.01, 0.04)  # sizes of a smooth function that are tried, as parts of the weights


@dataclass(frozen=True, slots=True, eq=False)
class QuadraticSummary:
    """Chi-squared of readings z about f (m,): f Q f - 2 f Q z + z Q z, a quadratic form."""

    precision: Array  # Q (m, m)
    pull: Array  # Q z (m,)
    square: float  # z Q z

    def __sub__(self, other: QuadraticSummary) -> QuadraticSummary:
        return QuadraticSummary(
            self.precision - other.precision, self.pull - other.pull, self.square - other.square
        )

    def without(self, out: NDArray[np.bool_]) -> QuadraticSummary:
        """Return what readings say of which some (m,) are held out."""
        held_rows = np.column_stack([self.precision[out], self.pull[out]])
        taken = held_rows.T @ np.linalg.solve(self.precision[np.ix_(out, out)], held_rows)
        return QuadraticSummary(
            self.precision - taken[:-1, :-1], self.pull - taken[:-1, -1],
            self.square - float(taken[-1, -1]),
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CrossValidationFold:
    """Summaries with a part of the readings held out.

    Attributes:
        rest, bare_rest: of the other readings, as `ResidualSummary.says` and `bare`.
        noise: squares that are held out and noise alone leaves.
    """

    rest: QuadraticSummary
    bare_rest: QuadraticSummary
    noise: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ResidualSummary:
    """Residuals as a function of a variable.

    Attributes:
        says: everything that may vary within tolerance is taken into its precision.
        bare: the same, no departure from any law taken into it.
        folds: parts of the readings, held out in turn; the same in all that are compared.
    """

    variable: Variable
    form: LawForm
    says: QuadraticSummary
    bare: QuadraticSummary
    folds: Sequence[CrossValidationFold]


@dataclass(frozen=True, slots=True, eq=False)
class _Shapes:
    """Shapes of one family for a variable and a form: columns (m, n_shapes)."""

    missed: ResidualSummary
    family: LawFamily
    numbers: Array  # (n, n_shapes)
    columns: Array
    gains: Array  # (n_shapes,) log Bayes factors

    @property
    def worth(self) -> float:
        """The log of the mean Bayes factor over the shapes."""
        return _log_mean(self.gains)


def dependence(summaries: Sequence[ResidualSummary], radius_m: float) -> FoundDependence | None:
    """Return the variable that the residuals depend on; None where nothing is likely enough."""
    summaries = [
        summary for summary in summaries if np.ptp(summary.form.seen(summary.variable)) > 1e-6
    ]
    families = [_tried(summary) for summary in summaries]
    odds = np.array(
        [_log_odds(missed, group) for missed, group in zip(summaries, families, strict=True)]
    )
    odds -= np.log(max(len(summaries), 1))
    if not len(odds) or odds.max() < MIN_PROBABILITY:
        return None
    chances = np.asarray(np.exp(odds - np.logaddexp.reduce(odds)), float)
    by_variable: dict[str, float] = {}
    for summary, chance in zip(summaries, chances, strict=True):
        phrase = summary.variable.phrase
        by_variable[phrase] = by_variable.get(phrase, 0.0) + float(chance)
    best = max(by_variable, key=lambda name: by_variable[name])
    index = max(
        (k for k, summary in enumerate(summaries) if summary.variable.phrase == best),
        key=lambda k: odds[k],
    )
    missed = summaries[index]
    law = None
    closed = 0.0
    if families[index]:
        closed = _closed([shapes for group in families for shapes in group])
        if closed > MIN_GAIN:
            law = _law(max(families[index], key=lambda shapes: shapes.worth))
    return FoundDependence(
        variable=missed.variable,
        form=missed.form,
        probability=by_variable[best],
        candidates=len(summaries),
        law=law,
        closed=closed,
        curve=_curve(missed, law),
        radius_m=radius_m,
    )


def _tried(missed: ResidualSummary) -> list[_Shapes]:
    variable, form = missed.variable, missed.form
    if not (variable.code and form.hook):
        return []
    suits = [family for family in FAMILIES if variable.scale in family.scales]
    every = [_shapes(missed, family, family.grid(form.seen(variable))) for family in suits]
    return [shapes for shapes in every if shapes.columns.shape[1]]


def _shapes(missed: ResidualSummary, family: LawFamily, numbers: Array) -> _Shapes:
    """Return what a family does with numbers (n, n_shapes), those left out that do nothing."""
    variable, form = missed.variable, missed.form
    allowed = np.all([row > 0.0 for row in _positive(family, numbers)], axis=0)
    numbers = numbers[:, np.broadcast_to(allowed, numbers.shape[1:])]
    columns = form.weights[:, None] * _centred(variable, form, family(variable.values, numbers))
    scale = np.sqrt(np.mean(columns**2, axis=0) / np.mean(form.weights**2))
    acts = scale > 1e-9
    columns = columns[:, acts] / scale[acts]
    return _Shapes(missed, family, numbers[:, acts], columns, _gains(missed.says, columns))


def _positive(family: LawFamily, numbers: Array) -> list[Array]:
    names = zip(family.numbers, numbers, strict=True)
    return [row for name, row in names if name in ("width", "length")]


def _centred(variable: Variable, form: LawForm, law: Array) -> Array:
    """Return a law's values (m, n) without their mean over a form's weights.

    A form that acts near the plate would else pass for a law of the distance; over all the
    thrust coefficient takes up the mean.
    """
    if not form.centred:
        return law
    mean: Array = np.average(law, axis=0, weights=form.weights**2)
    return law - mean


def _log_odds(missed: ResidualSummary, tried: Sequence[_Shapes]) -> float:
    """Return the log Bayes factor of a dependence over none: laws and smooth functions alike."""
    variable, form = missed.variable, missed.form
    rooted = form.weights[:, None] * _centred(variable, form, root(variable, form))
    smooth = _log_mean(np.array([_smooth(missed.says, size * rooted) for size in SMOOTH]))
    return _log_mean(np.array([smooth, *(shapes.worth for shapes in tried)]))


def _log_mean(logarithms: Array) -> float:
    """Return the log of a mean (n,) of which the logarithms are given."""
    return float(np.logaddexp.reduce(logarithms)) - float(np.log(len(logarithms)))


def _smooth(says: QuadraticSummary, columns: Array) -> float:
    inner = np.eye(columns.shape[1]) + columns.T @ says.precision @ columns
    pull = columns.T @ says.pull
    return float(0.5 * pull @ np.linalg.solve(inner, pull) - 0.5 * np.linalg.slogdet(inner)[1])


def _gains(says: QuadraticSummary, columns: Array) -> Array:
    """Return log Bayes factors of columns whose amplitude is free under a normal prior."""
    pull, weight = columns.T @ says.pull, np.sum(columns * (says.precision @ columns), axis=0)
    gains: Array = 0.5 * pull**2 / (weight + SIZE**-2) - 0.5 * np.log1p(SIZE**2 * weight)
    return gains


def root(variable: Variable, form: LawForm, more: Array | None = None) -> Array:
    """Return the root of the covariance of a smooth function of a variable (m + n_more, r).

    Over the logarithm of what is well above 0.
    """
    values = variable.values if more is None else np.concatenate([variable.values, more])
    if variable.blocks:
        result: Array = (values[:, None] == np.unique(values)).astype(float)
        return result
    seen = form.seen(variable)
    values = np.clip(values, seen.min(), seen.max())
    if _logarithmic(variable, seen):
        values, seen = np.log(values), np.log(seen)
    unique, rows = np.unique(np.round(values / np.ptp(seen), 2), return_inverse=True)
    squares = ((unique[:, None] - unique) / BENDS) ** 2
    size, axes = np.linalg.eigh(np.exp(-0.5 * squares))
    is_kept = size > 1e-6 * size[-1]
    smooth: Array = (axes[:, is_kept] * np.sqrt(size[is_kept]))[rows.reshape(-1)]
    return smooth


def _logarithmic(variable: Variable, seen: Array) -> bool:
    return variable.scale in ("positive", "distance") and bool(seen.min() > 0.02 * seen.max())


def _closed(every: Sequence[_Shapes]) -> float:
    """Return the share of the gap that laws close on readings that they were not chosen by."""
    before = after = noise = 0.0
    for number in range(len(every[0].missed.folds)):
        gains = [_gains(shapes.missed.folds[number].rest, shapes.columns) for shapes in every]
        best = max(range(len(every)), key=lambda k: _log_mean(gains[k]))
        law = every[best].columns[:, int(np.argmax(gains[best]))]
        missed = every[best].missed
        rest, fold = missed.folds[number].bare_rest, missed.folds[number]
        out = missed.bare - rest
        a = float(law @ rest.pull / (law @ rest.precision @ law + SIZE**-2))
        before += out.square
        after += out.square - 2.0 * a * float(law @ out.pull)
        after += a * a * float(law @ out.precision @ law)
        noise += fold.noise
    return float(np.clip((before - after) / max(before - noise, 1e-9), 0.0, 1.0))


def _law(shapes: _Shapes) -> Law:
    """Return the best law of a family, its numbers refined from the best shape tried."""
    missed, says = shapes.missed, shapes.missed.says
    u, weights = missed.variable.values, missed.form.weights
    numbers = shapes.numbers[:, int(np.argmax(shapes.gains))]
    if len(numbers) and shapes.family.name != "line":
        zoom = [0.4 * np.array([-1.0, -0.5, 0.0, 0.5, 1.0])] * len(numbers)
        around = np.array(np.meshgrid(*zoom)).reshape(len(numbers), -1)
        size = np.maximum(np.abs(numbers), 0.05)
        for turn in range(ZOOMS):
            tried = numbers[:, None] + size[:, None] * around * 0.7**turn
            near = _shapes(missed, shapes.family, tried)
            numbers = near.numbers[:, int(np.argmax(near.gains))]
    steps = 0.02 * np.maximum(np.abs(numbers), 0.02)
    columns = [weights * shapes.family(u, numbers)]
    weight = columns[0] @ says.precision @ columns[0]
    amplitude = float(columns[0] @ says.pull / weight)
    for k, step in enumerate(steps):
        moved = numbers + step * np.eye(len(numbers))[k]
        columns.append(amplitude * (weights * shapes.family(u, moved) - columns[0]) / step)
    slopes = np.stack(columns, axis=1)
    curvature = slopes.T @ says.precision @ slopes
    spread = np.sqrt(np.diag(np.linalg.pinv(curvature)))
    return Law(
        family=shapes.family,
        form=missed.form,
        amplitude=amplitude,
        amplitude_sd=float(spread[0]),
        numbers=tuple(float(value) for value in numbers),
        sds=tuple(float(value) for value in spread[1:]),
    )


def _curve(missed: ResidualSummary, law: Law | None) -> LawCurve:
    """Return the smooth function of the variable that fits the misses, and the law."""
    variable, form, says = missed.variable, missed.form, missed.says
    seen = form.seen(variable)
    spaced = np.geomspace if _logarithmic(variable, seen) else np.linspace
    at = np.asarray(spaced(seen.min(), seen.max(), 80), float)
    m = len(variable.values)
    both = max(SMOOTH) * root(variable, form, None if variable.blocks else at)
    columns = form.weights[:, None] * both[:m]
    spread = np.linalg.inv(np.eye(both.shape[1]) + columns.T @ says.precision @ columns)
    draws = spread @ (columns.T @ says.pull)
    if variable.blocks:
        at, smooth = variable.values, both
    else:
        smooth = both[m:]
    mean = smooth @ draws
    sd = np.sqrt(np.sum((smooth @ spread) * smooth, axis=1))
    counts = np.diag(says.precision)
    acts = np.abs(form.weights) > 0.05 * np.abs(form.weights).max()
    acts &= counts > 1e-9 * counts.max()
    # What one reading misses beside the smooth function, by its own weight in the precision.
    local_residuals = (says.pull - says.precision @ (columns @ draws)) / np.where(acts, counts, 1.0)
    shares = both[:m][acts] @ draws + local_residuals[acts] / form.weights[acts]
    drawn = np.empty(0) if law is None else law.amplitude * law.family(at, law.numbers)
    return LawCurve(
        at=at, mean=mean, low=mean - 1.96 * sd, high=mean + 1.96 * sd, law=drawn,
        points=variable.values[acts], shares=shares,
    )  # fmt: skip
