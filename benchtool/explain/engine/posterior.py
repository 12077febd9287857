"""Search for effects and discrepancies beyond their tolerances, by marginal likelihood.

An effect's size has a prior of two parts, within its tolerance and beyond. A discrepancy within its
tolerance is part of every hypothesis; beyond it is an unnamed effect. Probable members are added
one by one. Then all candidates are compared in place of each member, with the gain of the most
probable ones on the validation recordings included.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, log

import numpy as np

from benchtool.core.errors import EstimationError
from benchtool.explain.engine.bounded_least_squares import AMPLITUDES, UNDETERMINED_HINT
from benchtool.explain.engine.hypotheses import SMALL, Hypotheses, Hypothesis
from benchtool.explain.engine.subject import Subject, ValidationScore
from benchtool.explain.findings import UnnamedEffect
from benchtool.explain.result import EXCESS_ERROR, Kind
from benchtool.physics.effects.effect import Effect

Progress = Callable[[str, float], None]  # progress(task, completed share)

EFFECTS_MISSING = 0.3  # prior probability of an effect, shared among them; assumed
UNNAMED = 0.1  # prior probability of a discrepancy, shared among them; assumed
MAX_NAMED_EFFECTS = 5  # effects and discrepancies of one explanation
MAX_CONTENDERS = 4  # candidates of a trial that are compared on the validation recordings
CLASS_FROM = 0.05  # min probability of a class member; assumed
MAX_LOG_ODDS_GAP = 12.0  # below the best candidate; those further behind are not compared

UNEXPLAINED_ERROR = 2.0  # remaining error in noise floors above which an effect is missing; assumed
UNEXPLAINED_FACTOR = 0.05  # on probabilities of names if the error is unexplained; assumed
EXCESS_FACTOR = 0.9  # the same for a remaining error above EXCESS_ERROR; assumed

OTHER_LAW = "different law"  # candidate similar to the most probable effect, by another law
MIN_OTHER_LAW_SIZE = 4.0  # tolerances; a larger effect competes with a different law; assumed
DECISIVE_EVIDENCE = log(100.0)  # log evidence ratio (Jeffreys, Theory of Probability, 1961)

# Discrepancies of these stages do not affect named effects of others: thrust and torque are
# predicted from measured speeds, and a reading error is not a force.
SEPARATE_STAGES = ("pwm_to_rpm", "sensor")
CLASS_PROBABILITY = 0.15  # an effect and a discrepancy form a class if both exceed it
UNNAMED_DOMINANCE = 0.2  # sum of squares over that of all named effects; above: unknown; assumed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Trial:
    """Candidates for one missing effect, the others given."""

    base: Hypothesis  # without the effect
    tried: tuple[Hypothesis, ...]  # the base with each candidate added, most probable first
    log_odds: Mapping[str, float]  # over the base, prior included

    @property
    def name(self) -> str:
        """Name of the most probable candidate."""
        return self.tried[0].active[-1]

    @property
    def probabilities(self) -> dict[str, float]:
        """Probability of each candidate, and of "none"; they sum to 1."""
        top = max(0.0, *self.log_odds.values())
        weights = {name: exp(max(odds - top, -700.0)) for name, odds in self.log_odds.items()}
        weights["none"] = exp(max(-top, -700.0))
        total = sum(weights.values())
        return {name: weight / total for name, weight in weights.items()}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Posterior:
    """Result of a search by marginal likelihood."""

    hypotheses: Hypotheses  # of the training recordings
    null: Hypothesis
    best: Hypothesis  # all members are more probable than not; the null if it has none
    trials: tuple[Trial, ...]  # one for each member; a single one for the null

    @property
    def effects(self) -> dict[str, Effect]:
        """All effects of the model by name."""
        return {effect.name: effect for effect in self.hypotheses.evidence.model.effects}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Judgement:
    """Decision after a search, checked on the validation recordings."""

    kind: Kind
    search: Posterior
    predicted: Hypothesis  # for predictions: named effects, else the nearest one or the null
    score: ValidationScore
    weights: Sequence[Mapping[str, float]]  # of each trial: all effects, "none", "unknown"
    members: Sequence[tuple[int, str]]  # index of trial, name; of each named effect
    unnamed: Sequence[UnnamedEffect]


def judge(subject: Subject, rng: np.random.Generator, draws: int, progress: Progress) -> Judgement:
    """Return the missing effects by marginal likelihood."""
    hypotheses, held_out = Hypotheses(subject.evidence), Hypotheses(subject.all_evidence)
    search = search_models(hypotheses, held_out, progress)
    trials = [_add_other_law(subject, hypotheses, trial) for trial in search.trials]
    search = replace(search, trials=tuple(trials))
    unnamed = _find_unnamed(search)
    kind, members = _decide(search, unnamed)
    is_single = kind != "unknown" or len(search.trials) == 1
    if is_single and (pair := _find_inseparable(search)) is not None:
        index, effect, other = pair
        search = replace(search, best=hypotheses.converge(effect))
        kind, members = "class", [(index, effect.active[-1])]
        unnamed = [_describe(hypotheses, other, search.trials[index]), *unnamed]
    named = tuple(name for _, name in (members[:1] if kind == "class" else members))
    if members and set(search.best.active) != set(named):
        # Predict with the named effects only.
        search = replace(search, best=hypotheses.fit(named, search.best.values))
    nearest = _find_nearest(search, unnamed) if kind == "unknown" else None
    fit = search.best if members else nearest or search.null
    progress("predicting validation recordings", 0.8)
    score = ValidationScore.of(subject, hypotheses, held_out, (search.null, fit), rng, draws)
    weights = [_candidate_probabilities(hypotheses, trial) for trial in search.trials]
    error, unclosed = score.remaining_errors
    if (members and unclosed > UNEXPLAINED_ERROR) or (kind == "none" and error > UNEXPLAINED_ERROR):
        kind, members = "unknown", []
        weights = [_reduce_names(by_name, UNEXPLAINED_FACTOR) for by_name in weights]
    elif members and error > EXCESS_ERROR:
        kind = "class" if kind == "effect" else kind
        weights = [_reduce_names(by_name, EXCESS_FACTOR) for by_name in weights]
    return Judgement(
        kind=kind,
        search=search,
        predicted=fit,
        score=score,
        weights=weights,
        members=members,
        unnamed=unnamed,
    )


def _reduce_names(weights: Mapping[str, float], factor: float) -> dict[str, float]:
    """Scale all probabilities but "unknown" by a factor, after a bad prediction."""
    names = {name: factor * weight for name, weight in weights.items() if name != "unknown"}
    return {**names, "unknown": 1.0 - sum(names.values())}


def _add_other_law(subject: Subject, hypotheses: Hypotheses, trial: Trial) -> Trial:
    """Return a trial in which the most probable effect competes with a different law.

    Only if the effect is large or its law is not determined by the recordings, and unless the
    evidence against the other law is decisive.
    """
    top = trial.log_odds[trial.name]
    if trial.name not in hypotheses.effects or top <= 0.0:
        return trial
    effect = trial.tried[0]
    if hypotheses.size(effect) < MIN_OTHER_LAW_SIZE and not subject.free_law:
        return trial
    gain = hypotheses.other_law_evidence(effect) - hypotheses.log_evidence(effect)
    if gain < -DECISIVE_EVIDENCE:
        return trial
    return replace(trial, log_odds={**trial.log_odds, OTHER_LAW: top + max(gain, 0.0)})


def _find_unnamed(search: Posterior) -> list[UnnamedEffect]:
    """Return discrepancies beyond tolerance, largest first."""
    unnamed = [
        _describe(search.hypotheses, replace(search.best, active=(trial.name,)), trial)
        for trial in search.trials
        if trial.name in search.hypotheses.discrepancies and trial.name in search.best.active
    ]
    return sorted(unnamed, key=lambda effect: -effect.weight)


def _describe(hypotheses: Hypotheses, fit: Hypothesis, trial: Trial) -> UnnamedEffect:
    """Describe the last discrepancy of a hypothesis."""
    name = fit.active[-1]
    discrepancy = hypotheses.discrepancies[name]
    rows, shares = hypotheses.estimate_discrepancy(fit, name)
    tolerance = np.sqrt(np.sum(discrepancy.shares**2, axis=1)) / SMALL
    has_effect = tolerance > 0.0
    return UnnamedEffect(
        name=name,
        stage=discrepancy.stage,
        phrase=discrepancy.phrase,
        probability=1.0 - trial.probabilities["none"],
        share=float(np.max(np.abs(shares[has_effect]))),
        tolerances=float(np.max(np.abs(shares[has_effect]) / tolerance[has_effect])),
        weight=float(rows @ rows),
    )


def _find_inseparable(search: Posterior) -> tuple[int, Hypothesis, Hypothesis] | None:
    """Return the only probable effect and an about as probable discrepancy, with the trial index.

    None if there is no such pair.
    """
    hypotheses, candidates = search.hypotheses, []
    for index, trial in enumerate(search.trials if search.best.active else ()):
        by_name = trial.probabilities
        probable = [fit for fit in trial.tried if by_name[fit.active[-1]] > CLASS_PROBABILITY]
        effects = [fit for fit in probable if fit.active[-1] in hypotheses.effects]
        others = [fit for fit in probable if fit.active[-1] in hypotheses.discrepancies]
        if effects:
            candidates.append((index, effects[0], others))
    if len(candidates) != 1 or not candidates[0][2]:
        return None
    index, effect, others = candidates[0]
    return index, effect, others[0]


def _decide(
    search: Posterior, unnamed: Sequence[UnnamedEffect]
) -> tuple[Kind, list[tuple[int, str]]]:
    """Return the kind of verdict and its members, (index of trial, effect) each.

    The verdict is "unknown" if unnamed effects exceed `UNNAMED_DOMINANCE`; those of
    `SEPARATE_STAGES` do not count. A class contains effects that the recordings do not separate,
    and that such recordings are not expected to separate.
    """
    hypotheses = search.hypotheses
    named = [
        (index, trial)
        for index, trial in enumerate(search.trials)
        if search.best.active and trial.name in hypotheses.effects
    ]
    unnamed = [effect for effect in unnamed if effect.tolerances > 1.0]
    if not named:
        return ("unknown" if unnamed else "none"), []
    contribution = hypotheses.contribution(search.best, [trial.name for _, trial in named])
    max_weight = UNNAMED_DOMINANCE * float(contribution @ contribution)
    if sum(effect.weight for effect in unnamed if effect.stage not in SEPARATE_STAGES) > max_weight:
        return "unknown", []
    if len(named) > 1:
        named.sort(key=lambda item: -item[1].log_odds[item[1].name])
        return "several", [(index, trial.name) for index, trial in named]
    ((index, trial),) = named
    by_name = trial.probabilities
    if (law := by_name.get(OTHER_LAW, 0.0)) > 1.0 - CLASS_FROM:
        return "unknown", []
    total = sum(by_name[name] for name in hypotheses.effects if name in by_name)
    best, *others = trial.tried
    members = [trial.name] + [
        name
        for name in (fit.active[-1] for fit in others)
        if name in hypotheses.effects
        and by_name[name] > CLASS_FROM * total
        and hypotheses.evidence_against(best, name) < UNDETERMINED_HINT
    ]
    is_effect = len(members) == 1 and not law
    return "effect" if is_effect else "class", [(index, name) for name in members]


def _find_nearest(search: Posterior, unnamed: Sequence[UnnamedEffect]) -> Hypothesis | None:
    """Return the most probable effect in the stage of the unnamed ones; None if none is likely."""
    stages = {effect.stage == "pwm_to_rpm" for effect in unnamed} or {True, False}
    for trial in search.trials:
        for fit in trial.tried:
            name = fit.active[-1]
            effect = search.effects.get(name)
            if effect is None or trial.log_odds[name] <= 0.0:
                continue
            if (effect.subsystem == "pwm_to_rpm") in stages:
                return fit
    return None


def _candidate_probabilities(hypotheses: Hypotheses, trial: Trial) -> dict[str, float]:
    """Return probabilities of every effect, of "none" and of "unknown"; they sum to 1."""
    by_name = trial.probabilities
    unknown = sum(by_name.pop(name, 0.0) for name in (OTHER_LAW, *hypotheses.discrepancies))
    return {**by_name, "unknown": unknown}


def search_models(hypotheses: Hypotheses, held_out: Hypotheses, progress: Progress) -> Posterior:
    """Return the members beyond their tolerances, with all candidates for each.

    `held_out` has the evidence of training and validation recordings together.
    """
    if not hypotheses.effects:
        raise EstimationError("no effect can be tried: the model has no candidates on this bench")
    progress("fitting within tolerances", 0.05)
    base, first = hypotheses.fit_null(), None
    for index in range(MAX_NAMED_EFFECTS):
        progress(f"trying every effect, round {index + 1}", 0.1 + 0.08 * index)
        trial = _try_candidates(hypotheses, base)
        first = first or trial
        if trial.log_odds[trial.name] <= 0.0:
            break
        base = hypotheses.converge(trial.tried[0])
    assert first is not None
    best = _prune(hypotheses, base) if base.active else first.base
    progress("trying alternatives to each effect", 0.5)
    while True:
        trials = [first]  # one for each member, given the others
        if len(best.active) > 1:
            trials = [
                _try_candidates(hypotheses, hypotheses.fit_without(best, name))
                for name in best.active
            ]
        trials = [_with_validation(hypotheses, held_out, trial) for trial in trials]
        rejected = [trial for trial in trials if best.active and trial.log_odds[trial.name] <= 0.0]
        if not rejected:
            break
        worst = min(rejected, key=lambda trial: trial.log_odds[trial.name])
        member = next(name for name in best.active if name not in worst.base.active)
        best = hypotheses.fit_without(best, member)
    if best.active:
        best = max((trial.tried[0] for trial in trials), key=hypotheses.log_evidence)
        best = hypotheses.converge(best)
    return Posterior(hypotheses=hypotheses, null=first.base, best=best, trials=tuple(trials))


def _try_candidates(hypotheses: Hypotheses, base: Hypothesis) -> Trial:
    tried = hypotheses.add_candidates(base)
    effects = [fit for fit in tried if fit.active[-1] in hypotheses.effects]
    base = hypotheses.refit(base, effects[:2])
    # A candidate contains its base, so its cost is not higher.
    tried = [
        replace(base, active=fit.active)
        if fit.amplitudes == base.amplitudes and fit.cost > base.cost
        else fit
        for fit in tried
    ]
    min_evidence = hypotheses.log_evidence(tried[0]) - MAX_LOG_ODDS_GAP
    probable = [
        fit
        for fit in tried[:MAX_CONTENDERS]
        if fit.active[-1] in hypotheses.effects and hypotheses.log_evidence(fit) > min_evidence
    ]
    # A law is exact or off by its tolerance, with equal priors; use the more probable of the two.
    by_law = {fit.active[-1]: fit for fit in hypotheses.add_law_discrepancies(probable)}
    tried = [
        max(fit, by_law.get(fit.active[-1], fit), key=hypotheses.log_evidence) for fit in tried
    ]
    base_evidence = hypotheses.log_evidence(base)
    odds = dict[str, float]()
    for fit in tried:
        name = fit.active[-1]
        odds[name] = hypotheses.log_evidence(fit) - base_evidence + prior(hypotheses, name)
    return _build_trial(base, tried, odds)


def _build_trial(base: Hypothesis, tried: Sequence[Hypothesis], odds: dict[str, float]) -> Trial:
    tried = sorted(tried, key=lambda fit: odds[fit.active[-1]], reverse=True)
    return Trial(base=base, tried=tuple(tried), log_odds=odds)


def _with_validation(hypotheses: Hypotheses, held_out: Hypotheses, trial: Trial) -> Trial:
    """Return a trial whose main contenders are also scored on the validation recordings."""
    top = trial.log_odds[trial.name]
    if top <= 0.0:
        return trial

    def log_density(fit: Hypothesis) -> float:
        """Return the log of the predictive density of the validation recordings."""
        return held_out.log_evidence(held_out.refit_linear(fit)) - hypotheses.log_evidence(fit)

    base_density, odds = log_density(trial.base), dict(trial.log_odds)
    for fit in trial.tried[:MAX_CONTENDERS]:
        if odds[fit.active[-1]] > max(0.0, top - MAX_LOG_ODDS_GAP):
            odds[fit.active[-1]] += log_density(fit) - base_density
    return _build_trial(trial.base, trial.tried, odds)


def prior(hypotheses: Hypotheses, name: str) -> float:
    """Return the log prior odds of one more effect or discrepancy."""
    if name in hypotheses.discrepancies:
        return log(UNNAMED / (len(hypotheses.discrepancies) * len(AMPLITUDES)))
    return log(EFFECTS_MISSING / len(hypotheses.effects))


def _prune(hypotheses: Hypotheses, best: Hypothesis) -> Hypothesis:
    """Return the hypothesis without effects that became unnecessary after later additions."""
    for name in best.active[:-1]:
        smaller = hypotheses.fit_without(best, name)
        gain = hypotheses.log_evidence(best) - hypotheses.log_evidence(smaller)
        if gain + prior(hypotheses, name) <= 0.0:
            return _prune(hypotheses, smaller)
    return best
