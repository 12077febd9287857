"""Cross-validation of ground-effect laws over plate distances.

Each law replaces the law of the model and is fitted to all distances but one; its score is the log
density of the points at the held-out distance.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from scipy.special import stdtrit

from benchtool.core.errors import EstimationError, InputError, ModelRejected
from benchtool.core.units import Array
from benchtool.fit.compare import hold_out
from benchtool.fit.diagnose import find_error, with_diagnosis
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.problem import IntArray, Problem
from benchtool.physics.bases import with_rig_blades
from benchtool.physics.catalogue import EFFECTS, thrust_laws
from benchtool.physics.distance_law import DistanceLaw
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model

SAME_DISTANCE = 0.02  # relative; above the scatter of a stage; assumed
MIN_DISTANCES = 4  # fewer leave no degrees of freedom for k and a law of two parameters

NO_PLATE_Z_OVER_R = 1e3  # no plate beyond it: such points determine k and are not held out
MAX_KNOTS = 8  # knots of a tabulated law, at most two fewer than distances; assumed

SIGNIFICANCE = 0.01  # p-value of Wilcoxon's test; small, because folds share distances

TABLES = {name for name, effect in EFFECTS.items() if effect.knots_setting}  # tabulated laws

Verdict = Literal["best", "indistinguishable", "behind", "refused", "not applied"]


@dataclass(frozen=True, slots=True, kw_only=True)
class LawScore:
    """Score of one law; numbers are nan if it was not fitted."""

    law: str  # name of its effect
    verdict: Verdict
    reason: str = ""  # reason of a verdict "refused" or "not applied"
    one_with: tuple[str, ...] = ()  # equivalent laws (other parameters)
    parameters: int = 0  # number of free parameters, with k and noise
    values: str = ""  # fitted parameters as text
    chi2_per_dof: float = np.nan  # of the fit to all distances
    behind: float = np.nan  # mean loss of log score per distance against the best
    behind_se: float = np.nan  # its standard error, corrected for overlapping folds
    losses: tuple[float, ...] = ()  # of log score at each distance against the best
    held_out_rms: float = np.nan  # of held-out residuals, in the unit of the observations


@dataclass(frozen=True, slots=True, kw_only=True)
class LawComparison:
    """Scores of all laws, best first, and the compared distances."""

    scores: tuple[LawScore, ...]
    distances: tuple[float, ...]  # z/R, increasing

    def find_laws(self, *verdicts: Verdict) -> list[str]:
        """Return the names of the laws with one of these verdicts."""
        return [score.law for score in self.scores if score.verdict in verdicts]

    @property
    def sentence(self) -> str:
        """Return one sentence: best law, rejected laws, indistinguishable laws."""
        near, far = self.distances[0], self.distances[-1]
        where = f"At these {len(self.distances)} distances (z/R {near:.3g} to {far:.3g})"
        leading = self.find_laws("best", "indistinguishable")
        if not leading:
            nearest = self.scores[0].law
            return f"{where} the bench follows none of the laws: {nearest} comes nearest"
        best, *others = leading
        if others:
            summary = f"{best} predicts best; {_listed(others)} cannot be distinguished from it"
        elif best in TABLES:
            summary = f"the bench follows no law with a formula; {best} describes it"
        else:
            summary = f"the bench follows {best}"
        verdicts: tuple[Verdict, ...] = ("behind", "refused", "not applied")
        groups = {verdict: self.find_laws(verdict) for verdict in verdicts}
        parts = [f"{verdict}: {_listed(laws)}" for verdict, laws in groups.items() if laws]
        return "; ".join([f"{where} {summary}", *parts])


def _listed(names: list[str]) -> str:
    return ", ".join(names[:-1]) + (" and " if names[:-1] else "") + names[-1]


def compare_laws(
    model: Model, build_problem: Callable[[Model], Problem], z_over_R: Array
) -> LawComparison:
    """Return the scores of all applicable laws on held-out distances.

    Args:
        model: model whose law is replaced; its other free parameters (k, plate offset, K_b) are
            fitted with each law.
        z_over_R: (m,) smallest distance of each point of the problem.
    """
    group = distance_groups(z_over_R)
    distances = [float(z_over_R[group == number].mean()) for number in range(group.max() + 1)]
    if len(distances) < MIN_DISTANCES:
        raise InputError(
            f"{len(distances)} plate distances are too few to compare laws; minimum: "
            f"{MIN_DISTANCES}; measure at more distances, or compare models by name"
        )
    is_oge_known = bool(np.any(group < 0)) or not model.parameters["k"].free
    laws = [
        _fit_law(candidate, model, build_problem, distances, is_oge_known=is_oge_known)
        for candidate in candidate_laws(model)
    ]
    # If all laws are rejected, all are scored to find the nearest.
    is_accepted = any(not trial.score.reason for trial in laws)
    laws = [
        trial if trial.score.reason and is_accepted else _cross_validate(trial, group, distances)
        for trial in laws
    ]
    best = max(laws, key=lambda trial: (not trial.score.reason, trial.log_score))
    laws.sort(
        key=lambda trial: (
            trial.score.verdict == "not applied", -trial.log_score, trial.score.chi2_per_dof
        )
    )  # fmt: skip
    return LawComparison(
        scores=tuple(_score_law(trial, best) for trial in laws), distances=tuple(distances)
    )


def distance_groups(z_over_R: Array) -> IntArray:
    """Return the distance index of each point (m,), nearest first; -1 without a plate."""
    group = np.full(len(z_over_R), -1, np.intp)
    number, first = -1, -np.inf
    for i in np.argsort(z_over_R, kind="stable"):
        if z_over_R[i] >= NO_PLATE_Z_OVER_R:
            break
        if z_over_R[i] > first * (1.0 + SAME_DISTANCE) or number < 0:
            number, first = number + 1, z_over_R[i]
        group[i] = number
    return group


def candidate_laws(model: Model) -> Iterator[tuple[Effect, tuple[str, ...]]]:
    """Yield the laws to compare, each with its equivalents (same law, other parameters).

    The law of the model represents its equivalents. With several discs a law of a whole vehicle is
    not equivalent to a law of one rotor, because it replaces the terms of neighbours and body.
    """
    own_law = model.law
    laws = {effect.name: effect for effect in thrust_laws(model.rig.plate.surface)}
    if own_law is not None:
        laws[own_law.name] = own_law
    kinds: dict[tuple[str, bool], list[Effect]] = {}
    for effect in laws.values():
        kinds.setdefault(_kind(effect, model.rig.n_discs), []).append(effect)
    for (name, _), members in kinds.items():
        chosen = next((effect for effect in members if effect.name == name), members[0])
        chosen = own_law if own_law in members and own_law is not None else chosen
        yield chosen, tuple(effect.name for effect in members if effect is not chosen)


def _kind(effect: Effect, n_discs: int) -> tuple[str, bool]:
    law = _distance_law(effect)
    return law.same_as or effect.name, law.whole_vehicle and n_discs > 1


def _distance_law(effect: Effect) -> DistanceLaw:
    assert effect.distance_law is not None
    return effect.distance_law


@dataclass(frozen=True, slots=True, eq=False)
class _Trial:
    score: LawScore
    problem: Problem | None = None  # initial values from the fit to all distances
    density: Array | None = None  # (J,) summed log density of each held-out distance

    @property
    def log_score(self) -> float:
        return -np.inf if self.density is None else float(self.density.sum())


def _fit_law(
    candidate: tuple[Effect, tuple[str, ...]],
    model: Model,
    build_problem: Callable[[Model], Problem],
    distances: list[float],
    *,
    is_oge_known: bool,
) -> _Trial:
    """Return a law fitted to all distances, or the reason for its rejection."""
    effect, equivalent_laws = candidate
    score = LawScore(law=effect.name, verdict="refused", one_with=equivalent_laws)
    nearest = _distance_law(effect).nearest_z_over_R
    if distances[0] < nearest * (1.0 - 1e-9):
        reason = f"points at z/R {distances[0]:.3g}, valid from {nearest:g}"
        return _Trial(replace(score, verdict="not applied", reason=reason))
    try:
        start = with_law(model, effect, distances, is_oge_known=is_oge_known)
        problem = build_problem(initial_values(start, effect, distances))
        whole = fit_least_squares(problem)
    except EstimationError as error:
        return _Trial(replace(score, reason=str(error)))
    rejection = find_error((with_diagnosis(problem, whole),))
    reason = "" if rejection is None else whole.outcome.message
    if isinstance(rejection, ModelRejected):
        reason = f"rejected by chi2/dof {whole.chi2_per_dof:.3g}"
    score = replace(
        score,
        verdict="refused" if reason else "indistinguishable",
        reason=reason,
        parameters=len(whole.estimates),
        values=", ".join(
            f"{item.name.rpartition('.')[2]} {item.value:.4g}"
            for item in whole.estimates
            if item.name.startswith((f"{effect.name}.", "R_m"))
        ),
        chi2_per_dof=whole.chi2_per_dof,
    )
    return _Trial(score, problem.at(whole.values))


def initial_values(model: Model, effect: Effect, distances: list[float]) -> Model:
    """Return the model with a law strength whose singular distance is below all data.

    A search that starts beyond the singular distance does not converge.
    """
    law = _distance_law(effect)
    strength = next(item.name for item in effect.parameters if item.neutral is not None)
    name = f"{effect.name}.{strength}"
    parameter = model.parameters[name]
    if law.singular is None or not parameter.free:
        return model
    values = {item.name: item.value for item in effect.parameters}
    while law.singular(values) > 0.8 * distances[0]:
        values[strength] *= 0.5
    return model.with_values(
        model.parameters.with_replaced(name, parameter.with_value(values[strength]))
    )


def _cross_validate(trial: _Trial, group: IntArray, distances: list[float]) -> _Trial:
    """Return the trial with its scores at held-out distances."""
    problem = trial.problem
    if problem is None:
        return trial
    density, squares = np.zeros(len(distances)), 0.0
    for number, distance in enumerate(distances):
        try:
            logs, residuals = hold_out(problem, np.flatnonzero(group == number))
        except EstimationError as error:
            reason = f"without z/R {distance:.3g}: {error}"
            return _Trial(replace(trial.score, verdict="refused", reason=reason), problem)
        density[number] = logs.sum()
        squares += float(residuals @ residuals)
    rms = float(np.sqrt(squares / np.count_nonzero(group >= 0)))
    return _Trial(replace(trial.score, held_out_rms=rms), problem, density)


def with_law(
    model: Model, effect: Effect, distances: list[float], *, is_oge_known: bool = False
) -> Model:
    """Return the model with another law and the parameters of that law free.

    The law of the model itself is left unchanged. Under another law R is the rotor radius, because
    the law's parameters cover an effective radius; a tabulated law gets knots from the distances.

    Args:
        is_oge_known: the thrust out of ground effect is known independently, so that a tabulated
            law gets a knot beyond the largest distance.
    """
    if effect is model.law:
        return model
    law = _distance_law(effect)
    if effect.with_knots is not None:
        n = int(np.clip(len(distances) - 2, 2, MAX_KNOTS))
        indices = np.unique(np.linspace(0, len(distances) - 1, n).round().astype(int))
        knots = [*(distances[i] for i in indices), *([1.5 * distances[-1]] if is_oge_known else [])]
        effect = effect.with_knots(knots)
        law = _distance_law(effect)
    if law.whole_vehicle and model.rig.n_discs > 1:
        for other in model.effects:
            if other.hooks.denominator is not None and other.distance_law is None:
                model = model.without(other.name)
    commanded = law.basis == "equal commanded thrust"
    for other in model.effects if commanded else ():
        if other.hooks.response is not None:  # blade response applies to laws at equal power only
            model = model.without(other.name)
    model = model.with_fixed("R_m", model.rig.propulsion.radius_m).with_law(effect)
    model = with_rig_blades(model)
    return model.with_free(*(f"{effect.name}.{name}" for name in law.compared))


def _score_law(trial: _Trial, best: _Trial) -> LawScore:
    """Return the score of a law against the best one, one loss a distance.

    Training sets share nearly all distances, so the variance of the mean of J losses is corrected
    (Nadeau and Bengio, Machine Learning 52 (2003) 239). A large loss at one distance makes the
    standard error of the mean as large as the mean itself, so that a law is also behind if it loses
    at significantly many distances (Wilcoxon's test).
    """
    from scipy.stats import wilcoxon

    if trial.density is None or best.density is None:
        return trial.score
    lost, distances = best.density - trial.density, len(trial.density)
    behind = float(lost.mean())
    se = float(lost.std(ddof=1) * np.sqrt(1.0 / distances + 1.0 / (distances - 1)))
    verdict = trial.score.verdict
    if verdict == "indistinguishable" and trial is best:
        verdict = "best"
    elif verdict == "indistinguishable" and (
        behind > stdtrit(distances - 1, 0.975) * se
        or (lost.any() and wilcoxon(lost, alternative="greater").pvalue < SIGNIFICANCE)
    ):
        verdict = "behind"
    return replace(
        trial.score, verdict=verdict, behind=behind, behind_se=se, losses=tuple(lost.tolist())
    )
