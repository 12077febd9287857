"""Diagnosis of a fit in sentences: confused parameters, misfit, structured residuals, outliers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any, Literal

import numpy as np
from scipy.sparse.csgraph import connected_components
from scipy.special import chdtrc, fdtrc

from benchtool.core.errors import BenchtoolError, EstimationError, ModelRejected, NotConverged
from benchtool.core.fit_result import FitResult
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.fit.problem import NOISE_SCALE, Problem
from benchtool.fit.solve import PART, derivative_method, estimate_covariance, row_jacobian, solve
from benchtool.fit.statistics import (
    MAD_EFFICIENCY,
    MAD_TO_SD,
    Pattern,
    bend_along,
    outliers,
    runs_along,
    trend_along,
)
from benchtool.physics.catalogue import EFFECTS

Verdict = Literal["consistent", "scatter", "rejected", "errors_too_large", "no_verdict"]

SIGNIFICANCE = 1e-3  # smaller p-values are reported
# Largest residual over stated error that can be scatter missing from the stated errors (for example
# between visits), given a free noise parameter and no repeated setting; assumed.
MAX_UNSTATED_SCATTER = 4.0
# Residual over stated error, and misfit over the scatter of repeats, above which a model lacks
# something; assumed: scatter between visits is seldom larger.
MAX_SCATTER_RATIO = 2.0
MAX_NAMED_POINTS = 5

INFLATION = 5.0  # minimum ratio of sd with others free and fixed (a pair: correlation 0.98)
MIN_COMPONENT = 0.25  # minimum scaled component of a parameter in a confused direction
MIN_RELATIVE_SD = 0.1  # minimum reported sd relative to a value without tolerance
BASELINE: dict[frozenset[str], str] = {  # remedies for pairs without an effect
    frozenset({"k", "R_m"}): "reference points without the plate",
    frozenset({"k", "calibration.scale"}): "with a better calibration of the load cell",
}


@dataclass(frozen=True, slots=True, eq=False)
class Diagnosis:
    """Diagnosis of a fit from its residuals and derivatives.

    The verdict is from chi2 at the stated errors; "no_verdict" if they are unknown, "scatter" if a
    free noise parameter explains a moderate excess.
    """

    verdict: Verdict
    chance: float  # p-value of chi2 for a correct model and correct stated errors
    outliers: tuple[int, ...]  # (k,) point indices
    sentences: tuple[str, ...]  # messages for the user


def diagnose(problem: Problem, result: FitResult) -> Diagnosis:
    """Return the diagnosis of a least-squares or emcee result."""
    shape, noise = problem.split(result.values)
    loss: Any = result.facts.get("loss", "linear")
    whitening = problem.whitening(noise)
    rows = whitening(problem.residuals(result.values))
    if loss != "linear":  # residuals without shared errors, so that each outlier is one point
        rows = -solve(problem, whitening, shape, loss=loss).rows[: len(problem)]
    rows_alone = rows * np.sqrt(len(problem) / result.dof) if result.dof > 0 else rows
    # Under a robust loss chi2 has fewer effective degrees of freedom (`robust_chi2`).
    dof_share = 1.0 if loss == "linear" else MAD_EFFICIENCY
    p_value = float("nan")
    if result.dof > 0:
        p_value = float(chdtrc(dof_share * result.dof, dof_share * result.chi2))
    verdict, misfit = _verdict(problem, result, p_value), Pattern(0.0, 1.0)
    if verdict == "scatter" and loss == "linear":
        misfit = lack_of_fit(problem, result)
        if misfit.size > MAX_SCATTER_RATIO and misfit.chance < SIGNIFICANCE:
            verdict = "rejected"
    # Outliers are relative to the observed scatter if it exceeds the stated one.
    scatter = max(1.0, MAD_TO_SD * float(np.median(np.abs(rows_alone))))
    far_points = tuple(int(i) for i in outliers(rows_alone / scatter))
    sentences = (
        *_confusion_messages(problem, result),
        *_verdict_messages(verdict, result, p_value, misfit.size),
        *_structure_messages(problem, rows),
        *_outlier_messages(problem, rows_alone / scatter, far_points),
    )
    return Diagnosis(verdict, p_value, far_points, sentences)


def with_diagnosis(problem: Problem, result: FitResult) -> FitResult:
    """Return the result with the diagnosis among its warnings and facts."""
    diagnosis = diagnose(problem, result)
    return replace(
        result,
        warnings=(*result.warnings, *diagnosis.sentences),
        facts={
            **result.facts,
            "verdict": diagnosis.verdict,
            "chi2_chance": diagnosis.chance,
            "outliers": len(diagnosis.outliers),
        },
    )


def find_error(results: Sequence[FitResult]) -> BenchtoolError | None:
    """Return the error of failed results or of a rejected model; None if they are valid.

    A model is rejected if the p-value of its chi2 at the stated errors is below `SIGNIFICANCE`.
    With a free noise parameter, points must also scatter over `MAX_UNSTATED_SCATTER` stated errors.
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
        f"the data reject model {first.model!r}: points scatter {format_scatter_ratio(first)} as "
        f"much as their stated errors (chi2/dof = {first.chi2_per_dof:.3g}); do not use its "
        f"numbers before the missing effect is known: {_remedy(first)}"
    )


def _remedy(result: FitResult) -> str:
    """Return the remedy for a model that lacks an effect."""
    if result.facts.get("data") == "ratios":  # benchtool explain needs thrusts in N
        return "compare laws with --compare laws, or add an effect to the model"
    return "ask benchtool explain"


def _verdict(problem: Problem, result: FitResult, p_value: float) -> Verdict:
    relative = problem.noise_name == NOISE_SCALE and np.all(problem.standard_error == 1.0)
    if relative or not np.isfinite(p_value):
        return "no_verdict"
    if p_value < SIGNIFICANCE:
        is_moderate = result.chi2_per_dof < MAX_UNSTATED_SCATTER**2
        return "scatter" if problem.noise_name is not None and is_moderate else "rejected"
    return "errors_too_large" if p_value > 1.0 - SIGNIFICANCE else "consistent"


def _verdict_messages(
    verdict: Verdict, result: FitResult, p_value: float, misfit: float
) -> tuple[str, ...]:
    message = f"chi2/dof is {result.chi2_per_dof:.3g} ({result.chi2:.4g} over {result.dof})"
    noise_is_free = any(estimate.name.startswith("noise.") for estimate in result.estimates)
    scatter_text = f"points scatter {format_scatter_ratio(result)} as much as their stated errors"
    narrow_text = (
        f"the model lacks something and the intervals are too narrow; {_remedy(result)} before "
        f"these numbers are used"
    )
    if verdict == "rejected":
        advice = "add an effect"
        if not noise_is_free:
            advice += ", or free noise.scale if the stated errors are too small"
        if misfit:
            advice = f"its misfit is {misfit:.2g} times the scatter of repeats: {narrow_text}"
        elif has_misfit(result):
            advice = f"{scatter_text}: {narrow_text}"
        return (
            f"{message}: model {result.model!r} is rejected at the stated standard errors (chance "
            f"{f'{p_value:.1g}' if p_value > 1e-12 else 'below 1e-12'}); {advice}",
        )
    if verdict == "scatter":
        noise_text = (
            "the fitted noise widens the intervals accordingly, which is right for scatter between "
            "visits and wrong for a missing effect: look at the residuals"
        )
        return (f"{message}: {scatter_text}; {narrow_text if has_misfit(result) else noise_text}",)
    if verdict == "errors_too_large":
        advice = "correct them" if noise_is_free else "free noise.scale or correct them"
        for estimate in result.estimates:
            if estimate.name == NOISE_SCALE:
                advice = f"the intervals use {estimate.value:.2g} times these ({NOISE_SCALE})"
        return (f"{message}: the stated standard errors are larger than the scatter; {advice}",)
    return ()


def format_scatter_ratio(result: FitResult) -> str:
    """Return the ratio of scatter to stated errors as text."""
    return f"{np.sqrt(result.chi2_per_dof):.2g} times"


def has_misfit(result: FitResult) -> bool:
    """Return True if the residuals are so large that the model lacks an effect."""
    return result.chi2_per_dof > MAX_SCATTER_RATIO**2


def lack_of_fit(problem: Problem, result: FitResult) -> Pattern:
    """Return the ratio of lack of fit to pure error, with the p-value of the F test.

    A free level per setting separates them; the pure error is at least the stated errors.
    """
    shape, _ = problem.split(result.values)
    groups = problem.groups
    if groups is None or len(settings := np.unique(groups)) == len(groups):
        return Pattern(0.0, 1.0)
    whitening = problem.whitening(problem.stated_noise)
    rows = problem.rows(shape, whitening)
    jacobian = row_jacobian(problem, derivative_method(problem, shape), shape, whitening)
    levels = np.zeros((len(rows), len(settings)))
    levels[: len(problem)] = whitening(1.0 * (groups[:, None] == settings))
    columns = np.hstack([jacobian, levels])
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    coefficients, _, rank, _ = np.linalg.lstsq(columns, rows, rcond=1e-6)
    dof, misfit = len(rows) - int(rank), float(rows @ columns @ coefficients)
    if not 0 < dof < problem.dof:
        return Pattern(0.0, 1.0)
    scatter = max((float(rows @ rows) - misfit) / dof, 1.0)
    ratio = misfit / (problem.dof - dof) / scatter
    return Pattern(ratio**0.5, float(fdtrc(problem.dof - dof, dof, ratio)))


def _structure_messages(problem: Problem, rows: Array) -> list[str]:
    bends, sign_runs, slopes = [], [], []
    columns, order = dict(problem.covariates), np.arange(len(problem), dtype=float)
    if all(abs(trend_along(column, order).size) <= 0.9 for column in columns.values()):
        columns = {"order": order, **columns}
    for name, column in columns.items():
        bend_pattern, runs_pattern = bend_along(column, rows), runs_along(column, rows)
        trend_pattern = trend_along(column, rows)
        if bend_pattern.chance < SIGNIFICANCE:
            shape, ends, middle = ("a U", "below", "above")
            if bend_pattern.size <= 0.0:
                shape, ends, middle = ("an arch", "above", "below")
            bends.append(
                f"residuals form {shape} over {name}: the model is {ends} the points at both ends "
                f"and {middle} them between, so it misses a curve in {name}; {_hint(problem, name)}"
            )
        elif runs_pattern.chance < SIGNIFICANCE:
            sign_runs.append(
                f"residuals keep their sign along {name}: {runs_pattern.size} runs where "
                f"{runs_pattern.expected:.0f} are expected; the model misses a curve in {name}"
            )
        if trend_pattern.chance < SIGNIFICANCE:
            slopes.append(
                f"residuals {'rise' if trend_pattern.size > 0 else 'fall'} with {name} "
                f"(rank correlation {trend_pattern.size:+.2f}); {_hint(problem, name)}"
            )
    return bends + sign_runs + slopes


CLOCK = ("order", "time_s", "elapsed_s")  # time-like columns; repeated anchor points show trends


def _hint(problem: Problem, column: str) -> str:
    """Return the remedy for a trend: effects that are active on these data and not yet free."""
    names = [f"{effect.name}.{effect.parameters[0].name}" for effect in problem.missing(column)]
    present = [name for name in names if name in problem.parameters]
    absent = [name.partition(".")[0] for name in names if name not in problem.parameters]
    advice = [f"fit with --free {name}" for name in present if name not in problem.free_names]
    if absent:
        effects = " or ".join(absent)
        advice.append(f"fit a model with {effects} (see --model single_bench and quad_bench)")
    if column in CLOCK:
        advice.append("look at the anchor points")
    return ", or ".join(advice) or "look for an effect that depends on it"


def _outlier_messages(problem: Problem, rows: Array, points: tuple[int, ...]) -> tuple[str, ...]:
    if not points:
        return ()
    listed = ", ".join(f"{problem.label(i)}: {rows[i]:+.3g} sd" for i in points[:MAX_NAMED_POINTS])
    more = f" and {len(points) - MAX_NAMED_POINTS} more" if len(points) > MAX_NAMED_POINTS else ""
    return (
        f"outliers: {len(points)} of {pluralize(len(rows), 'point')} ({listed}{more}); check "
        f"these points in the run, or fit with a robust loss",
    )


def _confusion_messages(problem: Problem, result: FitResult) -> list[str]:
    """Return sentences on parameters that the data cannot separate, the worst first."""
    shape, noise = problem.split(result.values)
    with np.errstate(all="ignore"):
        method = derivative_method(problem, shape)
        jacobian = row_jacobian(problem, method, shape, problem.whitening(noise))
    names = problem.shape_names
    estimate = estimate_covariance(jacobian, method)
    if estimate.undetermined:
        # One sentence for each set of parameters that share undetermined directions.
        sizes = np.where(np.abs(estimate.directions) > PART, np.abs(estimate.directions), 0.0)
        _, group = connected_components(sizes @ sizes.T > 0.0)
        return [
            _confusion_message(names, sizes[rows].sum(axis=0), np.inf, int(rows.sum()))
            for rows in (group == number for number in dict.fromkeys(group[::-1]))
        ]
    confused = []
    norms = np.linalg.norm(jacobian, axis=0)
    inflation = np.sqrt(np.diag(estimate.covariance)) * norms
    _, singular, directions = np.linalg.svd(jacobian / norms, full_matrices=False)
    for direction in directions[singular < 1.0 / INFLATION][::-1]:  # the weakest first
        involved = np.abs(direction) > MIN_COMPONENT
        worst = float(inflation[involved].max())
        if worst >= INFLATION and any(
            _matters(problem, result, name) for name in compress(names, involved)
        ):
            confused.append(_confusion_message(names, np.abs(direction), worst))
    return confused


def _matters(problem: Problem, result: FitResult, name: str) -> bool:
    estimate, limit = result[name], problem.parameters[name].tolerance
    return estimate.sd > (MIN_RELATIVE_SD * abs(estimate.value) if limit is None else limit)


def _confusion_message(
    names: tuple[str, ...], involvement: Array, inflation: float, open_directions: int = 0
) -> str:
    """Return one sentence on confused parameters, the most involved first, with the remedy.

    Args:
        inflation: ratio of their sd to the sd with the others known.
        open_directions: number of undetermined combinations; 0 for none.
    """
    limit = 0.0 if open_directions else MIN_COMPONENT
    order = np.argsort(-involvement)
    involved = tuple(names[i] for i in order if involvement[i] > limit)
    separated_by = {
        frozenset({f"{effect.name}.{effect.parameters[0].name}", other}): text
        for effect in EFFECTS.values()
        for other, text in effect.separated_by.items()
    }
    remedies = [text for pair, text in (separated_by | BASELINE).items() if pair <= set(involved)]
    if remedies:
        remedy = f"measure {'; '.join(dict.fromkeys(remedies))}"
    elif len(involved) == 1:
        remedy = "measure where it acts"
    else:
        remedy = "measure at further plate distances and throttle levels, or state a prior"
    if len(involved) == 1:
        return f"these data do not determine {involved[0]}; fix it, or {remedy}"
    listed = " and ".join([", ".join(involved[:-1]), involved[-1]])
    if not open_directions:
        return (
            f"{listed} can hardly be separated (uncertainty {inflation:.0f} times larger "
            f"than with the others known); fix one, or {remedy}"
        )
    n_determined = len(involved) - open_directions
    return (
        f"{listed} cannot be separated by these data, which determine only {n_determined} "
        f"combination{'s' if n_determined > 1 else ''} of these {len(involved)}; fix "
        f"{open_directions}, or {remedy}"
    )
