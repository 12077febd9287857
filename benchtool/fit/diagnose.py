"""What is wrong with a fit, in sentences: confusion, misfit, structure, outliers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from benchtool.core.array import Array
from benchtool.core.counted import counted
from benchtool.core.errors import BenchtoolError, EstimationError, ModelRejected, NotConverged
from benchtool.core.fit_result import FitResult
from benchtool.fit.identifiability import Confusion, confusions
from benchtool.fit.problem import NOISE_SCALE, Problem
from benchtool.fit.residual_structure import (
    UNLIKELY,
    bend_along,
    chi2_chance,
    outliers,
    runs_along,
    trend_along,
)
from benchtool.physics.catalogue import EFFECTS

Verdict = Literal["consistent", "scatter", "rejected", "errors_too_large", "no_verdict"]

SCATTER = 4.0
"""Up to so many stated errors, what is left over may be scatter that they do not know of (between
visits of a bench, say), where a free noise parameter takes it up; a choice."""

TOO_MUCH = 2.0
"""From so many stated errors on, a fit says that its model lacks something: scatter between visits
is seldom more, and it makes no interval too narrow as a missing effect does; a choice."""

MOST_NAMED = 5


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """Hold what a fit's residuals and derivatives say.

    Attributes:
        verdict: on chi2 at the stated errors; "no_verdict" where they are unknown, "scatter" where
            a free noise parameter took up a little more than they state.
        chance: of a chi2 at least this large, were model and stated errors right.
        confusions: parameters that cannot be told apart.
        outliers: (k,) points far out.
        sentences: all of it that a user should read.
    """

    verdict: Verdict
    chance: float
    confusions: tuple[Confusion, ...]
    outliers: tuple[int, ...]
    sentences: tuple[str, ...]


def diagnose(problem: Problem, result: FitResult) -> Diagnosis:
    """Look at a result of a problem, from either estimator."""
    _, noise = problem.split(result.values)
    rows = problem.residuals(result.values) / problem.sigma(noise)
    rows_alone = rows * np.sqrt(len(problem) / result.dof) if result.dof > 0 else rows
    chance = chi2_chance(result.chi2, result.dof)
    verdict = _verdict(problem, result, chance)
    # Outliers are far out against the scatter that is there, be it the stated one or not.
    spread = max(1.0, float(1.4826 * np.median(np.abs(rows_alone))))
    far = tuple(int(i) for i in outliers(rows_alone / spread))
    confused = confusions(problem, result)
    sentences = (
        *(str(item) for item in confused),
        *_of_verdict(verdict, result, chance),
        *_of_structure(_columns(problem), rows, problem.parameters.free_names),
        *_of_outliers(problem, rows_alone / spread, far),
    )
    return Diagnosis(
        verdict=verdict,
        chance=chance,
        confusions=confused,
        outliers=far,
        sentences=tuple(sentences),
    )


def _columns(problem: Problem) -> dict[str, Array]:
    """Return the covariates, and the order of the points where it is not one of them."""
    order = np.arange(len(problem), dtype=float)
    same = [abs(trend_along(n, c, order).correlation) for n, c in problem.covariates.items()]
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
        status, said = result.outcome.status, f"{result.method}: {result.outcome.message}"
        if status == "not_converged":
            return NotConverged(said)
        if status != "converged":
            return EstimationError(said)
    first = results[0]
    if first.facts.get("verdict") != "rejected":
        return None
    return ModelRejected(
        f"the data reject model {first.model!r}: points scatter {times_as_much(first)} as much as "
        f"their stated errors (chi2/dof = {first.chi2_per_dof:.3g}); do not use its numbers before "
        f"benchtool explain has said what it lacks"
    )


def _verdict(problem: Problem, result: FitResult, chance: float) -> Verdict:
    relative = problem.noise_name == NOISE_SCALE and np.all(problem.standard_error == 1.0)
    if relative or not np.isfinite(chance):
        return "no_verdict"
    if chance < UNLIKELY:
        taken_up = problem.noise_name is not None and result.chi2_per_dof < SCATTER**2
        return "scatter" if taken_up else "rejected"
    return "errors_too_large" if chance > 1.0 - UNLIKELY else "consistent"


def _of_verdict(verdict: Verdict, result: FitResult, chance: float) -> tuple[str, ...]:
    said = f"chi2/dof is {result.chi2_per_dof:.3g} ({result.chi2:.4g} over {result.dof})"
    noise_is_free = any(item.name.startswith("noise.") for item in result.estimates)
    much = f"points scatter {times_as_much(result)} as much as their stated errors"
    narrow = (
        "the model lacks something and the intervals are too narrow; ask benchtool explain what, "
        "before these numbers are used"
    )
    if verdict == "rejected":
        advice = "add an effect"
        if not noise_is_free:
            advice += ", or free noise.scale if the errors leave scatter out"
        if lacks_something(result):
            advice = f"{much}: {narrow}"
        return (
            f"{said}: model {result.model!r} is rejected at the stated standard errors (chance "
            f"{f'{chance:.1g}' if chance > 1e-12 else 'below 1e-12'}); {advice}",
        )
    if verdict == "scatter":
        carried = (
            "the fitted noise carries that into the intervals, which is right for scatter between "
            "visits and wrong for a missing effect: look at the residuals"
        )
        return (f"{said}: {much}; {narrow if lacks_something(result) else carried}",)
    if verdict == "errors_too_large":
        advice = "state them anew" if noise_is_free else "free noise.scale or state them anew"
        return (f"{said}: the stated standard errors are larger than the scatter; {advice}",)
    return ()


def times_as_much(result: FitResult) -> str:
    """Return how many times as much as their stated errors the points scatter, in words."""
    return f"{np.sqrt(result.chi2_per_dof):.2g} times"


def lacks_something(result: FitResult) -> bool:
    """Whether so much is left over that the model lacks something and intervals are too narrow."""
    return result.chi2_per_dof > TOO_MUCH**2


def _of_structure(columns: Mapping[str, Array], rows: Array, free: tuple[str, ...]) -> list[str]:
    runs = [runs_along(name, column, rows) for name, column in columns.items()]
    trends = [trend_along(name, column, rows) for name, column in columns.items()]
    bends = [bend_along(name, column, rows) for name, column in columns.items()]
    bent = [bend for bend in bends if bend.chance < UNLIKELY]
    curved = [
        f"residuals form {'a U' if bend.curvature > 0.0 else 'an arch'} over {bend.column}: the "
        f"model is {'below' if bend.curvature > 0.0 else 'above'} the points at both ends and "
        f"{'above' if bend.curvature > 0.0 else 'below'} them between, so it misses a curve in "
        f"{bend.column}; {_hint(bend.column, free)}"
        for bend in bent
    ]
    curves = [
        f"residuals keep their sign along {run.column}: {run.runs} runs where "
        f"{run.expected:.0f} are expected; the model misses a curve in {run.column}"
        for run in runs
        if run.chance < UNLIKELY and run.column not in {bend.column for bend in bent}
    ]
    slopes = [
        f"residuals {'rise' if trend.correlation > 0 else 'fall'} with {trend.column} "
        f"(rank correlation {trend.correlation:+.2f}); {_hint(trend.column, free)}"
        for trend in trends
        if trend.chance < UNLIKELY
    ]
    return curved + curves + slopes


CLOCK = ("order", "time_s", "elapsed_s")
"""Columns that go with time: anchor points repeated over a run show more of what trends there."""


def _hint(column: str, free: tuple[str, ...]) -> str:
    """Say what to do about a trend; what is free already cannot be freed."""
    words = [
        f"the {effect.name.replace('_', ' ')}"
        for effect in EFFECTS.values()
        if column in effect.trends_over and f"{effect.name}.{effect.parameters[0].name}" not in free
    ]
    advice = [f"free {' or '.join(words)}"] if words else []
    if column in CLOCK:
        advice.append("look at the anchor points")
    return ", or ".join(advice) or "look for an effect that depends on it"


def _of_outliers(problem: Problem, rows: Array, far: tuple[int, ...]) -> tuple[str, ...]:
    if not far:
        return ()
    named = ", ".join(f"{problem.label(i)}: {rows[i]:+.1f} sd" for i in far[:MOST_NAMED])
    more = f" and {len(far) - MOST_NAMED} more" if len(far) > MOST_NAMED else ""
    return (
        f"far out: {len(far)} of {counted(len(rows), 'point')} ({named}{more}); look there in "
        f"the run, or fit with a robust loss",
    )
