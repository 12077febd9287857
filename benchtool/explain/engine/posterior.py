"""Search for what must break its tolerance, effect or discrepancy, and weigh what was tried.

One marginal likelihood decides. An effect's size has a prior of two parts, within its tolerance
and beyond; a discrepancy within its tolerance is part of every hypothesis, and beyond it is what
has no name. What is worth having is added one after the other; then each place is tried with
everything else in it, and what its likeliest member gains on the check recordings counts as well.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, log

import numpy as np

from benchtool.core.errors import EstimationError
from benchtool.explain.engine.describe import effect_size
from benchtool.explain.engine.evidence import Subject
from benchtool.explain.engine.held_out import ValidationScore
from benchtool.explain.engine.hypotheses import SMALL, Hypotheses, Hypothesis
from benchtool.explain.engine.judgement import CLASS_FROM, Judgement, Progress, Trial
from benchtool.explain.engine.shared_errors import AMPLITUDES
from benchtool.explain.engine.verdict import MOSTLY, Kind, UnnamedEffect
from benchtool.fit.identifiability import UNDETERMINED_HINT

EFFECTS_MISSING = 0.3  # prior probability of an effect, shared among them; assumed
UNNAMED = 0.1  # prior probability of a discrepancy, shared among them; assumed
MAX_NAMED_EFFECTS = 5  # how many effects and discrepancies one explanation may have
CONTENDERS, BEHIND = 4, 12.0  # of a place, tried on the check recordings; most log odds behind

MATTERS, NAMED_STILL = 2.0, 0.05
"""What is left of an explanation on the check recordings, in floors, from which on something that
matters is missing, whatever was named; and the part that names then keep of their probability."""

MOSTLY_NAMED = 0.9  # the same part where more than MOSTLY floors are left; assumed
LARGE = 4.0  # tolerances; from here on an effect competes with a different law; assumed
DECISIVE = log(100.0)  # log evidence ratio (Jeffreys, Theory of Probability, 1961)
OTHER_LAW = "different law"  # in log odds: what acts like the likeliest effect by another law

SEPARATE_STAGES = ("pwm_to_rpm", "sensor")
"""Stages whose departures leave the names of others alone: thrust and torques are predicted from
speeds that were read, and a reading's error is no force."""

CLASS_PROBABILITY = (
    0.15  # an effect and a discrepancy likelier than this for one place make a class
)
UNNAMED_DOMINANCE = 0.2  # part of the squares of its names from which a stage is unknown; assumed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Posterior:
    """Result of a search by marginal likelihood."""

    null: Hypothesis  # nothing beyond tolerance
    best: Hypothesis  # the hypothesis whose members are all worth having; the null when none is
    trials: tuple[Trial, ...]  # one for each of its members; one in all where there is none


def judge(
    subject: Subject,
    hypotheses: Hypotheses,
    rng: np.random.Generator,
    draws: int,
    progress: Progress,
) -> Judgement:
    """Return the missing effects by marginal likelihood."""
    search = search_models(hypotheses, Hypotheses(subject.all_evidence), progress)
    trials = [_add_other_law(subject, hypotheses, trial) for trial in search.trials]
    search = replace(search, trials=tuple(trials))
    unnamed = _unnamed(hypotheses, search)
    kind, members = _decide(hypotheses, search, unnamed)
    alone = kind != "unknown" or len(search.trials) == 1
    if alone and (rivals := _inseparable(hypotheses, search)) is not None:
        index, effect, other = rivals
        search = replace(search, best=hypotheses.converge(effect))
        kind, members = "class", [(index, effect.active[-1])]
        unnamed = [_describe(hypotheses, other, search.trials[index]), *unnamed]
    named = tuple(name for _, name in (members[:1] if kind == "class" else members))
    if members and set(search.best.active) != set(named):
        # Predictions are those of what is named: nothing beside it goes on without a name.
        search = replace(search, best=hypotheses.fitted(named, search.best.values))
    near = _nearest(subject, search, unnamed) if kind == "unknown" else None
    fitted = search.best if members else near or search.null
    progress("predicting the check recordings", 0.8)
    held = ValidationScore.of(subject, hypotheses, search.null, fitted, rng, draws)
    weights = [_weights(hypotheses, trial) for trial in search.trials]
    left, unclosed = held.left
    if (members and unclosed > MATTERS) or (kind == "none" and left > MATTERS):
        kind, members = "unknown", []
        weights = [_reduce_names(chances, NAMED_STILL) for chances in weights]
    elif members and left > MOSTLY:
        kind = "class" if kind == "effect" else kind
        weights = [_reduce_names(chances, MOSTLY_NAMED) for chances in weights]
    unknown = [chances["unknown"] for chances in weights]
    return Judgement(
        kind=kind,
        null=search.null,
        best=search.best,
        shown=fitted,
        held=held,
        trials=search.trials,
        weights=weights,
        members=members,
        unknown=max(unknown) if kind == "unknown" else min(unknown),
        unnamed=unnamed,
        beside=_other_effects(subject, hypotheses, search, unnamed) if kind == "unknown" else (),
    )


def _reduce_names(weights: Mapping[str, float], factor: float) -> dict[str, float]:
    """Return probabilities of a place with errors left: names keep a share of theirs."""
    names = {name: factor * share for name, share in weights.items() if name != "unknown"}
    return {**names, "unknown": 1.0 - sum(names.values())}


def _add_other_law(subject: Subject, hypotheses: Hypotheses, trial: Trial) -> Trial:
    """Return a trial whose likeliest effect competes with one like it by a different law.

    Only where it is large or nothing fixes the law; less than decisive evidence does not count.
    """
    top = trial.log_odds[trial.name]
    if trial.name not in hypotheses.effects or top <= 0.0:
        return trial
    effect = trial.tried[0]
    if hypotheses.size(effect) < LARGE and not subject.free_law:
        return trial
    ahead = hypotheses.by_other_law(effect) - hypotheses.log_evidence(effect)
    if ahead < -DECISIVE:
        return trial
    return replace(trial, log_odds={**trial.log_odds, OTHER_LAW: top + max(ahead, 0.0)})


def _other_effects(
    subject: Subject, hypotheses: Hypotheses, search: Posterior, unnamed: Sequence[UnnamedEffect]
) -> list[tuple[str, float]]:
    """Return effects in other stages than the unnamed ones, with probabilities."""
    stages = {departure.stage for departure in unnamed}
    return [
        (trial.name, 1.0 - probabilities(trial)["none"])
        for trial in search.trials
        if trial.name in hypotheses.effects
        and trial.name in search.best.active
        and effect_size(subject, trial.name).subsystem not in stages
    ]


def probabilities(trial: Trial) -> dict[str, float]:
    """Return the probability of each name in a place, and of "none"; they sum to 1."""
    top = max(0.0, *trial.log_odds.values())
    parts = {name: exp(max(odds - top, -700.0)) for name, odds in trial.log_odds.items()}
    parts["none"] = exp(max(-top, -700.0))
    total = sum(parts.values())
    return {name: part / total for name, part in parts.items()}


def _unnamed(hypotheses: Hypotheses, search: Posterior) -> list[UnnamedEffect]:
    """Return what departs beyond tolerance and has no name, the largest first."""
    departures = [
        _describe(hypotheses, replace(search.best, active=(trial.name,)), trial)
        for trial in search.trials
        if trial.name in hypotheses.discrepancies and trial.name in search.best.active
    ]
    return sorted(departures, key=lambda departure: -departure.weight)


def _describe(hypotheses: Hypotheses, fit: Hypothesis, trial: Trial) -> UnnamedEffect:
    """Describe the discrepancy that a hypothesis opens last."""
    name = fit.active[-1]
    discrepancy = hypotheses.discrepancies[name]
    rows, shares = hypotheses.estimate_discrepancy(fit, name)
    usual = np.sqrt(np.sum(discrepancy.shares**2, axis=1)) / SMALL
    acts = usual > 0.0
    return UnnamedEffect(
        name=name,
        stage=discrepancy.stage,
        phrase=discrepancy.phrase,
        probability=1.0 - probabilities(trial)["none"],
        share=float(np.max(np.abs(shares[acts]))),
        tolerances=float(np.max(np.abs(shares[acts]) / usual[acts])),
        weight=float(rows @ rows),
    )


def _inseparable(
    hypotheses: Hypotheses, search: Posterior
) -> tuple[int, Hypothesis, Hypothesis] | None:
    """Return the place of the only effect, it, and the discrepancy that is about as likely."""
    if not search.best.active:
        return None
    candidates = []
    for index, trial in enumerate(search.trials):
        chances = probabilities(trial)
        likely = [fit for fit in trial.tried if chances[fit.active[-1]] > CLASS_PROBABILITY]
        effects = [fit for fit in likely if fit.active[-1] in hypotheses.effects]
        others = [fit for fit in likely if fit.active[-1] in hypotheses.discrepancies]
        if effects:
            candidates.append((index, effects[0], others))
    if len(candidates) != 1 or not candidates[0][2]:
        return None
    index, effect, others = candidates[0]
    return index, effect, others[0]


def _decide(
    hypotheses: Hypotheses, search: Posterior, unnamed: Sequence[UnnamedEffect]
) -> tuple[Kind, list[tuple[int, str]]]:
    """Return the kind of verdict and its members: (place, effect) each.

    What has no name leaves the names of other stages alone; in the same stage it goes before them
    where it is larger than all of them together. A class is what this data did not tell apart, and
    such data could not be expected to.
    """
    named = [
        (index, trial)
        for index, trial in enumerate(search.trials)
        if search.best.active and trial.name in hypotheses.effects
    ]
    matters = [departure for departure in unnamed if departure.tolerances > 1.0]
    if not named:
        return ("unknown" if matters else "none"), []
    fitted = hypotheses.contribution(search.best, [trial.name for _, trial in named])
    main = [departure for departure in matters if departure.stage not in SEPARATE_STAGES]
    if sum(departure.weight for departure in main) > UNNAMED_DOMINANCE * float(fitted @ fitted):
        return "unknown", []
    if len(named) > 1:
        named.sort(key=lambda item: -item[1].log_odds[item[1].name])
        return "several", [(index, trial.name) for index, trial in named]
    ((index, trial),) = named
    chances = probabilities(trial)
    if (law := chances.get(OTHER_LAW, 0.0)) > 1.0 - CLASS_FROM:
        return "unknown", []
    total = sum(chances[name] for name in hypotheses.effects if name in chances)
    truth = trial.tried[0]
    members = [trial.name] + [
        fit.active[-1]
        for fit in trial.tried[1:]
        if fit.active[-1] in hypotheses.effects
        and chances[fit.active[-1]] > CLASS_FROM * total
        and hypotheses.evidence_against(truth, fit.active[-1]) < UNDETERMINED_HINT
    ]
    alone = len(members) == 1 and not law
    return "effect" if alone else "class", [(index, name) for name in members]


def _nearest(
    subject: Subject, search: Posterior, unnamed: Sequence[UnnamedEffect]
) -> Hypothesis | None:
    """Return the likeliest effect in the stage of what has no name, if any is worth a mention."""
    stages = {departure.stage == "pwm_to_rpm" for departure in unnamed} or {True, False}
    for trial in search.trials:
        for fit in trial.tried:
            name = fit.active[-1]
            effect = next((e for e in subject.evidence.model.effects if e.name == name), None)
            if effect is None or trial.log_odds[name] <= 0.0:
                continue
            if (effect.subsystem == "pwm_to_rpm") in stages:
                return fit
    return None


def _weights(hypotheses: Hypotheses, trial: Trial) -> dict[str, float]:
    """Return probabilities for one place: of every effect, of "none" and of "unknown"; sum 1."""
    chances = probabilities(trial)
    unknown = sum(chances.pop(name, 0.0) for name in (OTHER_LAW, *hypotheses.discrepancies))
    return {**chances, "unknown": unknown}


def search_models(hypotheses: Hypotheses, held_out: Hypotheses, progress: Progress) -> Posterior:
    """Return what must break its tolerance.

    Args:
        held_out: about those and the check recordings together.
    """
    if not hypotheses.effects:
        raise EstimationError("no effect can be tried: the model has no candidates on this bench")
    progress("fitting within tolerances", 0.05)
    base, first = hypotheses.null(), None
    for index in range(MAX_NAMED_EFFECTS):
        progress(f"trying every effect, round {index + 1}", 0.1 + 0.08 * index)
        trial = _trial(hypotheses, base)
        first = first or trial
        if trial.log_odds[trial.name] <= 0.0:
            break
        base = hypotheses.converge(trial.tried[0])
    assert first is not None
    best = _prune(hypotheses, base) if base.active else first.base
    progress("trying others in the place of each", 0.5)
    while True:
        trials = _build_trials(hypotheses, best, first)
        trials = [_with_check(hypotheses, held_out, trial) for trial in trials]
        lost = [trial for trial in trials if best.active and trial.log_odds[trial.name] <= 0.0]
        if not lost:
            break
        worst = min(lost, key=lambda trial: trial.log_odds[trial.name])
        gone = next(name for name in best.active if name not in worst.base.active)
        best = hypotheses.without(best, gone)
    if best.active:
        best = max((trial.tried[0] for trial in trials), key=hypotheses.log_evidence)
        best = hypotheses.converge(best)
    return Posterior(null=first.base, best=best, trials=tuple(trials))


def _build_trials(hypotheses: Hypotheses, best: Hypothesis, first: Trial) -> list[Trial]:
    """Return a trial for each member of a hypothesis, the others taken for granted."""
    if len(best.active) < 2:
        return [first]
    return [_trial(hypotheses, hypotheses.without(best, name)) for name in best.active]


def _trial(hypotheses: Hypotheses, base: Hypothesis) -> Trial:
    tried = hypotheses.add_candidates(base)
    effects = [fit for fit in tried if fit.active[-1] in hypotheses.effects]
    base = hypotheses.refit(base, effects[:2])
    # A candidate is never above its base: the base is one of its points.
    tried = [
        replace(base, active=fit.active)
        if fit.amplitudes == base.amplitudes and fit.cost > base.cost
        else fit
        for fit in tried
    ]
    least = hypotheses.log_evidence(tried[0]) - BEHIND
    likely = [
        fit
        for fit in tried[:CONTENDERS]
        if fit.active[-1] in hypotheses.effects and hypotheses.log_evidence(fit) > least
    ]
    # A law is exact or off by its tolerance, each as likely before: the better of both stands.
    rough = {fit.active[-1]: fit for fit in hypotheses.add_law_discrepancies(likely)}
    tried = [max(fit, rough.get(fit.active[-1], fit), key=hypotheses.log_evidence) for fit in tried]
    without = hypotheses.log_evidence(base)
    odds = {
        fit.active[-1]: hypotheses.log_evidence(fit) - without + prior(hypotheses, fit.active[-1])
        for fit in tried
    }
    return _ordered(base, tried, odds)


def _ordered(base: Hypothesis, tried: list[Hypothesis], odds: dict[str, float]) -> Trial:
    ordered = sorted(tried, key=lambda fit: odds[fit.active[-1]], reverse=True)
    return Trial(base=base, tried=tuple(ordered), log_odds=odds)


def _with_check(hypotheses: Hypotheses, held_out: Hypotheses, trial: Trial) -> Trial:
    """Return a trial whose odds count what its contenders gain on the check recordings, too."""
    top = trial.log_odds[trial.name]
    if top <= 0.0:
        return trial

    def gained(one: Hypothesis) -> float:
        """Return the log of the predictive density of the check recordings."""
        return held_out.log_evidence(held_out.near_fit(one)) - hypotheses.log_evidence(one)

    without, odds = gained(trial.base), dict(trial.log_odds)
    for fit in trial.tried[:CONTENDERS]:
        if odds[fit.active[-1]] > max(0.0, top - BEHIND):
            odds[fit.active[-1]] += gained(fit) - without
    return _ordered(trial.base, list(trial.tried), odds)


def prior(hypotheses: Hypotheses, name: str) -> float:
    """Return the log of the prior odds that a bench departs by one more name."""
    if name in hypotheses.discrepancies:
        return log(UNNAMED / (len(hypotheses.discrepancies) * len(AMPLITUDES)))
    return log(EFFECTS_MISSING / len(hypotheses.effects))


def _prune(hypotheses: Hypotheses, best: Hypothesis) -> Hypothesis:
    """Return the hypothesis without members that later ones made unnecessary."""
    for name in best.active[:-1]:
        less = hypotheses.without(best, name)
        gained = hypotheses.log_evidence(best) - hypotheses.log_evidence(less)
        if gained + prior(hypotheses, name) <= 0.0:
            return _prune(hypotheses, less)
    return best
