"""What is wrong with a fit, in sentences: confusion, misfit, structure, outliers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc, ndtr, stdtr
from scipy.stats import rankdata

from benchtool.core.array_type import Array
from benchtool.core.errors import BenchtoolError, EstimationError, ModelRejected, NotConverged
from benchtool.core.fit_result import FitResult
from benchtool.core.plural import pluralize
from benchtool.fit.identifiability import Confusion, confusions
from benchtool.fit.jacobian import select_method
from benchtool.fit.problem import NOISE_SCALE, Problem
from benchtool.fit.robust import LOSSES, MAD_EFFICIENCY, MAD_TO_SD, Loss
from benchtool.fit.solve import row_jacobian, solve

Verdict = Literal["consistent", "scatter", "rejected", "errors_too_large", "no_verdict"]

UNLIKELY = 1e-3  # a chance below this is reported
# Up to so many stated errors, what is left over may be scatter that they leave out (between visits,
# say), where a free noise parameter takes it up and no setting is repeated; assumed.
SCATTER = 4.0
# From so many stated errors on a model lacks something, and so does one that settings miss so many
# times as much as repeats scatter; assumed: scatter between visits is seldom more.
MAX_SCATTER_RATIO = 2.0
MAX_NAMED_POINTS = 5


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """Hold what a fit's residuals and derivatives say.

    Attributes:
        verdict: on chi2 at the stated errors; "no_verdict" where they are unknown, "scatter" where
            a free noise parameter took up a little more than they state.
    """

    verdict: Verdict
    chance: float  # of a chi2 at least this large, were model and stated errors right
    confusions: tuple[Confusion, ...]  # parameters that this data cannot separate
    outliers: tuple[int, ...]  # (k,) points far out
    sentences: tuple[str, ...]  # all of it that a user should read


def diagnose(problem: Problem, result: FitResult) -> Diagnosis:
    """Look at a result of a problem, from either estimator."""
    shape, noise = problem.split(result.values)
    loss: Loss = next(one for one in LOSSES if one == result.facts.get("loss", "linear"))
    whitening = problem.whitening(noise)
    rows = whitening(problem.residuals(result.values))
    if loss != "linear":  # what is left in a point's own error, so that each outlier is one point
        rows = -solve(problem, whitening, shape, loss=loss).rows[: len(problem)]
    rows_alone = rows * np.sqrt(len(problem) / result.dof) if result.dof > 0 else rows
    # Under a robust loss chi2 stands for fewer degrees of freedom (`robust_chi2`).
    share = 1.0 if loss == "linear" else MAD_EFFICIENCY
    chance = float("nan")
    if result.dof > 0:
        chance = float(chdtrc(share * result.dof, share * result.chi2))
    verdict, lack = _verdict(problem, result, chance), Pattern(0.0, 1.0)
    if verdict == "scatter" and loss == "linear":
        lack = lack_of_fit(problem, result)
        if lack.size > MAX_SCATTER_RATIO and lack.chance < UNLIKELY:
            verdict = "rejected"
    # Outliers are far out against the scatter that is there, be it the stated one or not.
    spread = max(1.0, MAD_TO_SD * float(np.median(np.abs(rows_alone))))
    far = tuple(int(i) for i in outliers(rows_alone / spread))
    confused = confusions(problem, result)
    sentences = (
        *(str(item) for item in confused),
        *_of_verdict(verdict, result, chance, lack.size),
        *_of_structure(problem, rows),
        *_of_outliers(problem, rows_alone / spread, far),
    )
    return Diagnosis(verdict, chance, confused, far, sentences)


def _columns(problem: Problem) -> dict[str, Array]:
    """Return the covariates, and the order of the points where it is not one of them."""
    order = np.arange(len(problem), dtype=float)
    same = [abs(trend_along(column, order).size) for column in problem.covariates.values()]
    return {**({} if max(same, default=0.0) > 0.9 else {"order": order}), **problem.covariates}


def with_diagnosis(problem: Problem, result: FitResult) -> FitResult:
    """Return the result with the diagnosis among its warnings and facts."""
    found = diagnose(problem, result)
    return replace(
        result,
        warnings=(*result.warnings, *found.sentences),
        facts={
            **result.facts,
            "verdict": found.verdict,
            "chi2_chance": found.chance,
            "outliers": len(found.outliers),
        },
    )


def refusal(results: Sequence[FitResult]) -> BenchtoolError | None:
    """Return why results are no answer (`EstimationError`) or reject their model; None otherwise.

    A model is rejected where the chance of its chi2 at the stated errors is below `UNLIKELY`, or,
    with a noise parameter free, where points scatter more than `SCATTER` times as much as stated.
    """
    for result in results:
        status, message = result.outcome.status, f"{result.method}: {result.outcome.message}"
        if status == "not_converged":
            return NotConverged(message)
        if status != "converged":
            return EstimationError(message)
    first = results[0]
    if first.facts.get("verdict") != "rejected":
        return None
    return ModelRejected(
        f"the data reject model {first.model!r}: points scatter {times_as_much(first)} as much as "
        f"their stated errors (chi2/dof = {first.chi2_per_dof:.3g}); do not use its numbers before "
        f"what it lacks is known: {_remedy(first)}"
    )


def _remedy(result: FitResult) -> str:
    """Return what to do about a model that lacks something."""
    if result.facts.get("data") == "ratios":  # benchtool explain takes thrusts in N
        return "compare laws with --compare laws, or add an effect to the model"
    return "ask benchtool explain"


def _verdict(problem: Problem, result: FitResult, chance: float) -> Verdict:
    relative = problem.noise_name == NOISE_SCALE and np.all(problem.standard_error == 1.0)
    if relative or not np.isfinite(chance):
        return "no_verdict"
    if chance < UNLIKELY:
        taken_up = problem.noise_name is not None and result.chi2_per_dof < SCATTER**2
        return "scatter" if taken_up else "rejected"
    return "errors_too_large" if chance > 1.0 - UNLIKELY else "consistent"


def _of_verdict(verdict: Verdict, result: FitResult, chance: float, lack: float) -> tuple[str, ...]:
    message = f"chi2/dof is {result.chi2_per_dof:.3g} ({result.chi2:.4g} over {result.dof})"
    noise_is_free = any(item.name.startswith("noise.") for item in result.estimates)
    much = f"points scatter {times_as_much(result)} as much as their stated errors"
    narrow = (
        f"the model lacks something and the intervals are too narrow; {_remedy(result)} before "
        f"these numbers are used"
    )
    if verdict == "rejected":
        advice = "add an effect"
        if not noise_is_free:
            advice += ", or free noise.scale if the errors leave scatter out"
        if lack:
            advice = f"settings miss it {lack:.2g} times as much as repeats scatter: {narrow}"
        elif has_misfit(result):
            advice = f"{much}: {narrow}"
        return (
            f"{message}: model {result.model!r} is rejected at the stated standard errors (chance "
            f"{f'{chance:.1g}' if chance > 1e-12 else 'below 1e-12'}); {advice}",
        )
    if verdict == "scatter":
        carried = (
            "the fitted noise carries that into the intervals, which is right for scatter between "
            "visits and wrong for a missing effect: look at the residuals"
        )
        return (f"{message}: {much}; {narrow if has_misfit(result) else carried}",)
    if verdict == "errors_too_large":
        advice = "state them anew" if noise_is_free else "free noise.scale or state them anew"
        for item in result.estimates:
            if item.name == NOISE_SCALE:
                advice = f"the intervals take {item.value:.2g} times those ({NOISE_SCALE})"
        return (f"{message}: the stated standard errors are larger than the scatter; {advice}",)
    return ()


def times_as_much(result: FitResult) -> str:
    """Return how many times as much as their stated errors the points scatter, in words."""
    return f"{np.sqrt(result.chi2_per_dof):.2g} times"


def has_misfit(result: FitResult) -> bool:
    """Whether so much is left over that the model lacks something and intervals are too narrow."""
    return result.chi2_per_dof > MAX_SCATTER_RATIO**2


class Pattern(NamedTuple):
    """What residuals do along a column, and the chance that noise alone does as much."""

    size: float
    chance: float
    expected: float = 0.0  # of noise


def lack_of_fit(problem: Problem, result: FitResult) -> Pattern:
    """Return how many times as much settings miss the model as repeats scatter, or are stated to.

    A level of its own for every setting takes the misfit off chi2 and leaves the scatter; the
    chance is that of the F test of both.
    """
    shape, _ = problem.split(result.values)
    groups = problem.groups
    if groups is None or len(settings := np.unique(groups)) == len(groups):
        return Pattern(0.0, 1.0)
    whitening = problem.whitening(problem.stated_noise)
    rows = problem.rows(shape, whitening)
    way = select_method(problem.predict, shape, len(problem), *problem.shape_bounds)
    levels = np.zeros((len(rows), len(settings)))
    levels[: len(problem)] = whitening(1.0 * (groups[:, None] == settings))
    free = np.hstack([row_jacobian(problem, way)(shape, whitening), levels])
    free = free / np.maximum(np.linalg.norm(free, axis=0), 1e-300)
    taken, _, rank, _ = np.linalg.lstsq(free, rows, rcond=1e-6)
    dof, misfit = len(rows) - int(rank), float(rows @ free @ taken)
    if not 0 < dof < problem.dof:
        return Pattern(0.0, 1.0)
    scatter = max((float(rows @ rows) - misfit) / dof, 1.0)
    ratio = misfit / (problem.dof - dof) / scatter
    return Pattern(ratio**0.5, float(fdtrc(problem.dof - dof, dof, ratio)))


def bend_along(order: Array, rows: Array) -> Pattern:
    """Return the curvature of weighted residuals (m,) over a column (m,): above 0 for a U.

    It is that of a parabola through them, over the half width of the column; the chance is that of
    Student's t for its last coefficient. Counting runs cannot see a U in ten points; this can.
    """
    width = 0.5 * np.ptp(order) if len(order) else 0.0
    if len(rows) < 5 or width == 0.0 or len(np.unique(order)) < 4:
        return Pattern(0.0, 1.0)
    x = (order - order.min()) / width - 1.0
    powers = np.stack([np.ones_like(x), x, x * x], axis=1)
    inverse = np.linalg.pinv(powers.T @ powers)
    found = inverse @ (powers.T @ rows)
    left = rows - powers @ found
    dof = len(rows) - 3
    size, sd = float(found[2]), float(np.sqrt(left @ left / dof * inverse[2, 2]))
    if sd <= 1e-12 * abs(size):
        return Pattern(size, 0.0 if abs(size) > 1e-9 else 1.0)
    return Pattern(size, 2.0 * float(stdtr(dof, -abs(size) / sd)))


def runs_along(order: Array, rows: Array) -> Pattern:
    """Count runs of equal sign of weighted residuals (m,) along a column (m,).

    Fewer than chance gives mean a missed curve. Points of equal column value stand for one, by
    their mean. The chance is that of so few runs (Wald and Wolfowitz, Ann. Math. Stat. 11, 1940),
    normal approximation.
    """
    values, place = np.unique(order, return_inverse=True)
    positive = np.bincount(place, rows) > 0.0
    up, down = int(positive.sum()), int((~positive).sum())
    n = len(values)
    runs = 1 + int((positive[1:] != positive[:-1]).sum()) if n else 0
    if up < 3 or down < 3:
        return Pattern(runs, 1.0, runs)
    expected = 1.0 + 2.0 * up * down / n
    variance = 2.0 * up * down * (2.0 * up * down - n) / (n * n * (n - 1.0))
    return Pattern(runs, float(ndtr((runs + 0.5 - expected) / np.sqrt(variance))), expected)


def trend_along(order: Array, rows: Array) -> Pattern:
    """Return Spearman's rank correlation of weighted residuals (m,) with a column (m,)."""
    m = len(rows)
    if m < 5 or np.ptp(order) == 0.0 or np.ptp(rows) == 0.0:
        return Pattern(0.0, 1.0)
    r = float(np.corrcoef(rankdata(order), rankdata(rows))[0, 1])
    t = abs(r) * np.sqrt((m - 2.0) / max(1.0 - r * r, 1e-12))
    return Pattern(r, 2.0 * float(stdtr(m - 2, -t)))


def outliers(rows: Array) -> NDArray[np.intp]:
    """Return points (k,) so far out that fewer than 0.05 of their kind were expected (Chauvenet).

    The worst comes first.
    """
    chance = 2.0 * ndtr(-np.abs(rows)) * len(rows)
    far = np.flatnonzero(chance < 0.05)
    return far[np.argsort(-np.abs(rows[far]))].astype(np.intp)


def _of_structure(problem: Problem, rows: Array) -> list[str]:
    curved, curves, slopes = [], [], []
    for name, column in _columns(problem).items():
        hint = partial(_hint, problem, name)
        bend, runs = bend_along(column, rows), runs_along(column, rows)
        trend = trend_along(column, rows)
        if bend.chance < UNLIKELY:
            shape, ends, between = ("a U", "below", "above")
            if bend.size <= 0.0:
                shape, ends, between = ("an arch", "above", "below")
            curved.append(
                f"residuals form {shape} over {name}: the model is {ends} the points at both ends "
                f"and {between} them between, so it misses a curve in {name}; {hint()}"
            )
        elif runs.chance < UNLIKELY:
            curves.append(
                f"residuals keep their sign along {name}: {runs.size} runs where "
                f"{runs.expected:.0f} are expected; the model misses a curve in {name}"
            )
        if trend.chance < UNLIKELY:
            slopes.append(
                f"residuals {'rise' if trend.size > 0 else 'fall'} with {name} "
                f"(rank correlation {trend.size:+.2f}); {hint()}"
            )
    return curved + curves + slopes


CLOCK = ("order", "time_s", "elapsed_s")  # columns that go with time; repeated anchors show trends


def _hint(problem: Problem, column: str) -> str:
    """Say what to do about a trend; what is free already, or cannot act here, is not named."""
    words = [
        f"the {effect.name.replace('_', ' ')}"
        for effect in problem.missing(column)
        if f"{effect.name}.{effect.parameters[0].name}" not in problem.free_names
    ]
    advice = [f"free {' or '.join(words)}"] if words else []
    if column in CLOCK:
        advice.append("look at the anchor points")
    return ", or ".join(advice) or "look for an effect that depends on it"


def _of_outliers(problem: Problem, rows: Array, far: tuple[int, ...]) -> tuple[str, ...]:
    if not far:
        return ()
    named = ", ".join(f"{problem.label(i)}: {rows[i]:+.3g} sd" for i in far[:MAX_NAMED_POINTS])
    more = f" and {len(far) - MAX_NAMED_POINTS} more" if len(far) > MAX_NAMED_POINTS else ""
    return (
        f"far out: {len(far)} of {pluralize(len(rows), 'point')} ({named}{more}); look there in "
        f"the run, or fit with a robust loss",
    )
