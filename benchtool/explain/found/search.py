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

from benchtool.core.array import Array
from benchtool.explain.found.families import FAMILIES, Family
from benchtool.explain.found.law import Dependence, Form, Law, LawCurve, Variable

SIZE = 0.03
"""Standard deviation of what a law changes, root mean square over the weights; a choice."""

SURE = 5.0
"""Least log odds of a dependence over none, the look around paid for."""

WORTH = 0.3
"""Least share of the held-out gap that a law closes to be drafted."""

FOLDS = 10
"""Parts of the readings, whole places of the plate each, that are held out in turn."""

BENDS = 0.3
"""Part of a variable's range over which a smooth function of it may change; a choice."""

ZOOMS = 10
"""Rounds in which the shape of a law is refined."""

SMOOTH = (0.01, 0.04)
"""Sizes of a smooth function that are tried, as parts of the weights."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Missed:
    """Hold what readings miss (m,) and everything that it may depend on.

    Attributes:
        precision, pull: Q (m, m) and Q z (m,).
        bare_precision, bare_pull: the same, no departure from any law taken into Q.
        places: number of each reading's place, held out as one.
    """

    precision: Array
    pull: Array
    bare_precision: Array
    bare_pull: Array
    places: NDArray[np.intp]
    variables: Sequence[Variable]
    forms: Sequence[Form]
    radius_m: float  # R of the rotors
    thrust_N: float  # the median of what the cell should read


@dataclass(frozen=True, slots=True, eq=False)
class _Shapes:
    """Hold the shapes of one family for a variable and a form: columns (m, n_shapes)."""

    variable: Variable
    form: Form
    family: Family
    numbers: Array  # (n, n_shapes)
    columns: Array
    pulled: Array  # (m, n_shapes) Q columns


def dependence(missed: Missed) -> Dependence | None:
    """Return what the misses depend on; None where nothing is likely enough."""
    pairs = [
        (variable, form)
        for variable in missed.variables
        for form in missed.forms
        if form.name in variable.forms and np.ptp(form.seen(variable)) > 1e-6
    ]
    tried = [_tried(missed, *pair) for pair in pairs]
    every = [one for group in tried for one in group]
    odds = np.array(
        [_log_odds(missed, pair, group) for pair, group in zip(pairs, tried, strict=True)]
    )
    odds -= np.log(len(pairs))
    if not len(odds) or odds.max() < SURE:
        return None
    chances = np.asarray(np.exp(odds - np.logaddexp.reduce(odds)), float)
    by_variable = {
        variable.phrase: sum(
            chance for chance, (other, _) in zip(chances, pairs, strict=True) if other is variable
        )
        for variable in missed.variables
    }
    best = max(by_variable, key=lambda name: by_variable[name])
    place = max(
        (k for k, (variable, _) in enumerate(pairs) if variable.phrase == best),
        key=lambda k: odds[k],
    )
    variable, form = pairs[place]
    law = None
    closed = 0.0
    if tried[place]:
        closed = _closed(missed, every)
        if closed > WORTH:
            law = _law(missed, max(tried[place], key=lambda one: _of_family(missed, one)))
    return Dependence(
        variable=variable,
        form=form,
        probability=float(by_variable[best]),
        candidates=len(pairs),
        law=law,
        closed=closed,
        curve=_curve(missed, variable, form, law),
        radius_m=missed.radius_m,
        thrust_N=missed.thrust_N,
    )


def _tried(missed: Missed, variable: Variable, form: Form) -> list[_Shapes]:
    if variable.blocks:
        return []
    suits = [family for family in FAMILIES if variable.scale in family.scales]
    every = [_shapes(missed, variable, form, one, one.grid(form.seen(variable))) for one in suits]
    return [one for one in every if one.columns.shape[1]]


def _shapes(
    missed: Missed, variable: Variable, form: Form, family: Family, numbers: Array
) -> _Shapes:
    """Return what a family does with numbers (n, n_shapes), those left out that do nothing."""
    allowed = np.all([row > 0.0 for row in _positive(family, numbers)], axis=0)
    numbers = numbers[:, np.broadcast_to(allowed, numbers.shape[1:])]
    columns = form.weights[:, None] * _centred(variable, form, family(variable.values, numbers))
    scale = np.sqrt(np.mean(columns**2, axis=0) / np.mean(form.weights**2))
    acts = scale > 1e-9
    columns = columns[:, acts] / scale[acts]
    return _Shapes(variable, form, family, numbers[:, acts], columns, missed.precision @ columns)


def _positive(family: Family, numbers: Array) -> list[Array]:
    names = zip(family.numbers, numbers, strict=True)
    return [row for name, row in names if name in ("width", "length")]


def _centred(variable: Variable, form: Form, law: Array) -> Array:
    """Return a law's values (m, n) without their mean over a form's weights.

    A form that acts near the plate would else pass for a law of the distance; over all the
    thrust coefficient takes up the mean.
    """
    if not form.phrase:
        return law
    mean: Array = np.average(law, axis=0, weights=form.weights**2)
    return law - mean


def _log_odds(missed: Missed, pair: tuple[Variable, Form], tried: Sequence[_Shapes]) -> float:
    """Return the log Bayes factor of a dependence over none: laws and smooth functions alike."""
    variable, form = pair
    rooted = form.weights[:, None] * _centred(variable, form, root(variable, form))
    found = [_smooth(missed, size * rooted) for size in SMOOTH]
    parts = [float(np.logaddexp.reduce(found)) - np.log(len(found))]
    parts += [_of_family(missed, one) for one in tried]
    return float(np.logaddexp.reduce(parts)) - float(np.log(len(parts)))


def _smooth(missed: Missed, columns: Array) -> float:
    inner = np.eye(columns.shape[1]) + columns.T @ missed.precision @ columns
    pull = columns.T @ missed.pull
    return float(0.5 * pull @ np.linalg.solve(inner, pull) - 0.5 * np.linalg.slogdet(inner)[1])


def _of_family(missed: Missed, one: _Shapes) -> float:
    """Return the log of the mean Bayes factor over a family's shapes."""
    gains = _gains(one.columns.T @ missed.pull, np.sum(one.columns * one.pulled, axis=0))
    return float(np.logaddexp.reduce(gains)) - float(np.log(len(gains)))


def _gains(pull: Array, weight: Array) -> Array:
    """Return log Bayes factors of columns whose amplitude is free under a normal prior."""
    gains: Array = 0.5 * pull**2 / (weight + SIZE**-2) - 0.5 * np.log1p(SIZE**2 * weight)
    return gains


def root(variable: Variable, form: Form, more: Array | None = None) -> Array:
    """Return the root of the covariance of a smooth function of a variable (m + n_more, r).

    Over the logarithm of what is well above 0.
    """
    values = variable.values if more is None else np.concatenate([variable.values, more])
    if variable.blocks:
        found: Array = (values[:, None] == np.unique(values)).astype(float)
        return found
    seen = form.seen(variable)
    values = np.clip(values, seen.min(), seen.max())
    if _logarithmic(variable, seen):
        values, seen = np.log(values), np.log(seen)
    unique, rows = np.unique(np.round(values / np.ptp(seen), 2), return_inverse=True)
    squares = ((unique[:, None] - unique) / BENDS) ** 2
    size, axes = np.linalg.eigh(np.exp(-0.5 * squares))
    shown = size > 1e-6 * size[-1]
    smooth: Array = (axes[:, shown] * np.sqrt(size[shown]))[rows.reshape(-1)]
    return smooth


def _logarithmic(variable: Variable, seen: Array) -> bool:
    return variable.scale in ("positive", "distance") and bool(seen.min() > 0.02 * seen.max())


def _closed(missed: Missed, every: Sequence[_Shapes]) -> float:
    """Return the share of the gap that laws close on places that they were not chosen by."""
    rng = np.random.default_rng(0)
    numbers = np.unique(missed.places)
    part = rng.permutation(len(numbers)) % FOLDS
    before = after = rows = 0.0
    bare, bare_pull = missed.bare_precision, missed.bare_pull
    for fold in range(FOLDS):
        out = np.isin(missed.places, numbers[part == fold])
        if not out.any():
            continue
        own = missed.precision[np.ix_(out, out)]
        here = np.linalg.solve(own, missed.pull[out])
        best, law = -np.inf, np.zeros(len(out))
        for one in every:
            held = np.linalg.solve(own, one.pulled[out])
            pull = one.columns.T @ missed.pull - one.pulled[out].T @ here
            weight = np.sum(one.columns * one.pulled, axis=0) - np.sum(
                one.pulled[out] * held, axis=0
            )
            gains = _gains(pull, weight)
            worth = float(np.logaddexp.reduce(gains)) - float(np.log(len(gains)))
            if worth > best:
                k, best = int(np.argmax(gains)), worth
                law = one.columns[:, k]
        own, pulled = bare[np.ix_(out, out)], bare @ law
        here, held = np.linalg.solve(own, np.stack([bare_pull[out], pulled[out]], axis=1)).T
        weight = law @ pulled - pulled[out] @ held + SIZE**-2
        left = here - float((law @ bare_pull - pulled[out] @ here) / weight) * held
        before += float(here @ own @ here)
        after += float(left @ own @ left)
        rows += len(here)
    return float(np.clip((before - after) / max(before - rows, 1e-9), 0.0, 1.0))


def _law(missed: Missed, one: _Shapes) -> Law:
    """Return the best law of a family, its numbers refined from the best shape tried."""
    gains = _gains(one.columns.T @ missed.pull, np.sum(one.columns * one.pulled, axis=0))
    u, weights = one.variable.values, one.form.weights
    numbers = one.numbers[:, int(np.argmax(gains))]
    if len(numbers) and one.family.name != "line":
        zoom = [0.4 * np.array([-1.0, -0.5, 0.0, 0.5, 1.0])] * len(numbers)
        around = np.array(np.meshgrid(*zoom)).reshape(len(numbers), -1)
        size = np.maximum(np.abs(numbers), 0.05)
        for turn in range(ZOOMS):
            tried = numbers[:, None] + size[:, None] * around * 0.7**turn
            near = _shapes(missed, one.variable, one.form, one.family, tried)
            gains = _gains(near.columns.T @ missed.pull, np.sum(near.columns * near.pulled, axis=0))
            numbers = near.numbers[:, int(np.argmax(gains))]
    steps = 0.02 * np.maximum(np.abs(numbers), 0.02)
    columns = [weights * one.family(u, numbers)]
    weight = columns[0] @ missed.precision @ columns[0]
    amplitude = float(columns[0] @ missed.pull / weight)
    for k, step in enumerate(steps):
        moved = numbers + step * np.eye(len(numbers))[k]
        columns.append(amplitude * (weights * one.family(u, moved) - columns[0]) / step)
    slopes = np.stack(columns, axis=1)
    curvature = slopes.T @ missed.precision @ slopes
    spread = np.sqrt(np.diag(np.linalg.pinv(curvature)))
    return Law(
        family=one.family,
        form=one.form,
        amplitude=amplitude,
        amplitude_sd=float(spread[0]),
        numbers=tuple(float(value) for value in numbers),
        sds=tuple(float(value) for value in spread[1:]),
    )


def _curve(missed: Missed, variable: Variable, form: Form, law: Law | None) -> LawCurve:
    """Return the smooth function of the variable that the misses ask for, and the law."""
    seen = form.seen(variable)
    spaced = np.geomspace if _logarithmic(variable, seen) else np.linspace
    at = np.asarray(spaced(seen.min(), seen.max(), 80), float)
    m = len(variable.values)
    both = max(SMOOTH) * root(variable, form, None if variable.blocks else at)
    columns = form.weights[:, None] * both[:m]
    spread = np.linalg.inv(np.eye(both.shape[1]) + columns.T @ missed.precision @ columns)
    draws = spread @ (columns.T @ missed.pull)
    if variable.blocks:
        at, shown = variable.values, both
    else:
        shown = both[m:]
    mean = shown @ draws
    sd = np.sqrt(np.sum((shown @ spread) * shown, axis=1))
    acts = np.abs(form.weights) > 0.05 * np.abs(form.weights).max()
    # What one reading misses beside the smooth function, by its own weight in the precision.
    own = (missed.pull - missed.precision @ (columns @ draws)) / np.diag(missed.precision)
    shares = both[:m][acts] @ draws + own[acts] / form.weights[acts]
    drawn = np.empty(0) if law is None else law.amplitude * law.family(at, law.numbers)
    return LawCurve(
        at=at, mean=mean, low=mean - 1.96 * sd, high=mean + 1.96 * sd, law=drawn,
        points=variable.values[acts], shares=shares,
    )  # fmt: skip
