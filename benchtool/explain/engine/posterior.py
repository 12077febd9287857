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
from benchtool.explain.engine.describe import effect_of
from benchtool.explain.engine.held_out import HeldOut
from benchtool.explain.engine.hypotheses import SMALL, Hypotheses, Hypothesis
from benchtool.explain.engine.judgement import CLASS_FROM, Judgement, Progress, Trial
from benchtool.explain.engine.shared_errors import AMPLITUDES
from benchtool.explain.engine.subject import Subject
from benchtool.explain.engine.verdict import Kind, Unnamed
from benchtool.fit.identifiability import CANNOT_TELL

EFFECTS_MISSING = 0.3
"""How often a bench lacks an effect of the library beyond its tolerance; shared among them."""

UNNAMED = 0.1
"""How often it departs in a way that no effect describes; shared among the discrepancies."""

MOST_NAMES = 5
"""How many effects and discrepancies one explanation may have."""

CONTENDERS, BEHIND = 4, 12.0
"""So many of a place are held against the check recordings, none further behind in log odds."""

MATTERS, NAMED_STILL = 2.0, 0.05
"""What is left of an explanation on the check recordings, in floors, from which on something that
matters is missing, whatever was named; and the part that names then keep of their probability."""

APART = ("pwm_to_rpm", "sensor")
"""Stages whose departures leave the names of others alone: thrust and torques are predicted from
speeds that were read, and a reading's error is no force."""

AS_WELL = 0.15
"""An effect and a discrepancy that are both likelier than this for the one place make a class."""

OVERSHADOWED = 0.2
"""What has no name goes before the names of its stage from this part of their squares on: a law's
own departures stay below, and something larger could be all of it."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Posterior:
    """Hold what a search by marginal likelihood found."""

    null: Hypothesis  # nothing beyond tolerance
    best: Hypothesis  # the hypothesis whose members are all worth having; the null when none is
    trials: tuple[Trial, ...]  # one for each of its members; one in all where there is none


def judged(
    subject: Subject,
    hypotheses: Hypotheses,
    rng: np.random.Generator,
    draws: int,
    progress: Progress,
) -> Judgement:
    """Return what is missing by the marginal likelihood of every hypothesis."""
    search = searched(hypotheses, Hypotheses(subject.all_evidence), progress)
    unnamed = _unnamed(hypotheses, search)
    kind, members = _decided(hypotheses, search, unnamed)
    if (rivals := _inseparable(hypotheses, search)) is not None:
        effect, other = rivals
        search = replace(search, best=hypotheses.settled(effect))
        kind, members = "class", [(0, effect.opened[-1])]
        unnamed = [_described(hypotheses, other, search.trials[0])]
    named = tuple(name for _, name in members)
    if kind in ("effect", "several") and set(search.best.opened) != set(named):
        # Predictions are those of what is named: nothing beside it goes on without a name.
        search = replace(search, best=hypotheses.fitted(named, search.best.at))
    near = _nearest(subject, search, unnamed) if kind == "unknown" else None
    shown = search.best if members else near or search.null
    progress("predicting the check recordings", 0.8)
    held = HeldOut.of(subject, hypotheses, search.null, shown, rng, draws)
    weights = [_weights(hypotheses, trial) for trial in search.trials]
    if members and held.left > MATTERS:
        kind, members = "unknown", []
        weights = [_refused(one) for one in weights]
    unknown = [one["unknown"] for one in weights]
    return Judgement(
        kind=kind,
        null=search.null,
        best=search.best,
        shown=shown,
        held=held,
        trials=search.trials,
        weights=weights,
        members=members,
        unknown=max(unknown) if kind == "unknown" else min(unknown),
        unnamed=unnamed,
        beside=_beside(subject, hypotheses, search, unnamed) if kind == "unknown" else (),
    )


def _refused(weights: Mapping[str, float]) -> dict[str, float]:
    """Return probabilities for one place where something larger than what is named is left."""
    left = {name: NAMED_STILL * one for name, one in weights.items() if name != "unknown"}
    return {**left, "unknown": 1.0 - sum(left.values())}


def _beside(
    subject: Subject, hypotheses: Hypotheses, search: Posterior, unnamed: Sequence[Unnamed]
) -> list[tuple[str, float]]:
    """Return the effects of other stages that are there beside what has no name."""
    stages = {one.stage for one in unnamed}
    return [
        (trial.name, 1.0 - probabilities(trial)["none"])
        for trial in search.trials
        if trial.name in hypotheses.effects
        and trial.name in search.best.opened
        and effect_of(subject, trial.name).subsystem not in stages
    ]


def probabilities(trial: Trial) -> dict[str, float]:
    """Return the probability of each name in a place, and of "none"; they sum to 1."""
    top = max(0.0, *trial.log_odds.values())
    parts = {name: exp(max(odds - top, -700.0)) for name, odds in trial.log_odds.items()}
    parts["none"] = exp(max(-top, -700.0))
    total = sum(parts.values())
    return {name: part / total for name, part in parts.items()}


def _unnamed(hypotheses: Hypotheses, search: Posterior) -> list[Unnamed]:
    """Return what departs beyond tolerance and has no name, the largest first."""
    found = [
        _described(hypotheses, replace(search.best, opened=(trial.name,)), trial)
        for trial in search.trials
        if trial.name in hypotheses.discrepancies and trial.name in search.best.opened
    ]
    return sorted(found, key=lambda one: -one.weight)


def _described(hypotheses: Hypotheses, one: Hypothesis, trial: Trial) -> Unnamed:
    """Describe the discrepancy that a hypothesis opens last."""
    name = one.opened[-1]
    discrepancy = hypotheses.discrepancies[name]
    rows, shares = hypotheses.taken_up(one, name)
    usual = np.sqrt(np.sum(discrepancy.shares**2, axis=1)) / SMALL
    acts = usual > 0.0
    return Unnamed(
        name=name,
        stage=discrepancy.stage,
        phrase=discrepancy.phrase,
        probability=1.0 - probabilities(trial)["none"],
        share=float(np.max(np.abs(shares[acts]))),
        tolerances=float(np.max(np.abs(shares[acts]) / usual[acts])),
        weight=float(rows @ rows),
    )


def _inseparable(hypotheses: Hypotheses, search: Posterior) -> tuple[Hypothesis, Hypothesis] | None:
    """Return the likeliest effect and the discrepancy that may as well be all there is."""
    if len(search.trials) != 1 or not search.best.opened:
        return None
    chances = probabilities(search.trials[0])
    likely = [one for one in search.trials[0].tried if chances[one.opened[-1]] > AS_WELL]
    effects = [one for one in likely if one.opened[-1] in hypotheses.effects]
    others = [one for one in likely if one.opened[-1] in hypotheses.discrepancies]
    return (effects[0], others[0]) if effects and others else None


def _decided(
    hypotheses: Hypotheses, search: Posterior, unnamed: Sequence[Unnamed]
) -> tuple[Kind, list[tuple[int, str]]]:
    """Return the kind of verdict and its members: (place, effect) each.

    What has no name leaves the names of other stages alone; in the same stage it goes before them
    where it is larger than all of them together. A class is what this data did not tell apart, and
    such data could not be expected to.
    """
    named = [
        (place, trial)
        for place, trial in enumerate(search.trials)
        if search.best.opened and trial.name in hypotheses.effects
    ]
    matters = [one for one in unnamed if one.tolerances > 1.0]
    if not named:
        return ("unknown" if matters else "none"), []
    shown = hypotheses.contribution(search.best, [trial.name for _, trial in named])
    main = [one for one in matters if one.stage not in APART]
    if sum(one.weight for one in main) > OVERSHADOWED * float(shown @ shown):
        return "unknown", []
    if len(named) > 1:
        named.sort(key=lambda one: -one[1].log_odds[one[1].name])
        return "several", [(place, trial.name) for place, trial in named]
    ((place, trial),) = named
    chances = probabilities(trial)
    total = sum(chances[name] for name in hypotheses.effects if name in chances)
    truth = trial.tried[0]
    members = [trial.name] + [
        one.opened[-1]
        for one in trial.tried[1:]
        if one.opened[-1] in hypotheses.effects
        and chances[one.opened[-1]] > CLASS_FROM * total
        and hypotheses.evidence_against(truth, one.opened[-1]) < CANNOT_TELL
    ]
    return "effect" if len(members) == 1 else "class", [(place, name) for name in members]


def _nearest(subject: Subject, search: Posterior, unnamed: Sequence[Unnamed]) -> Hypothesis | None:
    """Return the likeliest effect in the stage of what has no name, if any is worth a mention."""
    stages = {one.stage == "pwm_to_rpm" for one in unnamed}
    for trial in search.trials:
        for one in trial.tried:
            name = one.opened[-1]
            effect = next((e for e in subject.evidence.model.effects if e.name == name), None)
            if effect is None or trial.log_odds[name] <= 0.0:
                continue
            if (effect.subsystem == "pwm_to_rpm") in stages:
                return one
    return None


def _weights(hypotheses: Hypotheses, trial: Trial) -> dict[str, float]:
    """Return probabilities for one place: of every effect, of "none" and of "unknown"; sum 1."""
    chances = probabilities(trial)
    unknown = sum(chances.pop(name, 0.0) for name in hypotheses.discrepancies)
    return {**chances, "unknown": unknown}


def searched(hypotheses: Hypotheses, held_out: Hypotheses, progress: Progress) -> Posterior:
    """Return what must break its tolerance.

    Args:
        hypotheses: about the recordings to learn from.
        held_out: about those and the check recordings together.
        progress: called with what is being done.
    """
    if not hypotheses.effects:
        raise EstimationError("no effect can be tried: the model has no candidates on this bench")
    progress("fitting within tolerances", 0.05)
    base, first = hypotheses.null(), None
    for place in range(MOST_NAMES):
        progress(f"trying every effect, round {place + 1}", 0.1 + 0.08 * place)
        trial = _trial(hypotheses, base)
        first = first or trial
        if trial.log_odds[trial.name] <= 0.0:
            break
        base = hypotheses.settled(trial.tried[0])
    assert first is not None
    best = _pruned(hypotheses, base) if base.opened else first.base
    progress("trying others in the place of each", 0.5)
    while True:
        trials = _places(hypotheses, best, first)
        trials = [_with_check(hypotheses, held_out, trial) for trial in trials]
        lost = [trial for trial in trials if best.opened and trial.log_odds[trial.name] <= 0.0]
        if not lost:
            break
        worst = min(lost, key=lambda trial: trial.log_odds[trial.name])
        gone = next(name for name in best.opened if name not in worst.base.opened)
        best = hypotheses.without(best, gone)
    if best.opened:
        best = max((trial.tried[0] for trial in trials), key=hypotheses.log_evidence)
        best = hypotheses.settled(best)
    return Posterior(null=first.base, best=best, trials=tuple(trials))


def _places(hypotheses: Hypotheses, best: Hypothesis, first: Trial) -> list[Trial]:
    """Return a trial for each member of a hypothesis, the others taken for granted."""
    if len(best.opened) < 2:
        return [first]
    return [_trial(hypotheses, hypotheses.without(best, name)) for name in best.opened]


def _trial(hypotheses: Hypotheses, base: Hypothesis) -> Trial:
    tried = hypotheses.with_one_more(base)
    effects = [one for one in tried if one.opened[-1] in hypotheses.effects]
    base = hypotheses.secured(base, effects[:2])
    # A candidate is never above its base: the base is one of its points.
    tried = [
        replace(base, opened=one.opened)
        if one.widened == base.widened and one.cost > base.cost
        else one
        for one in tried
    ]
    least = hypotheses.log_evidence(tried[0]) - BEHIND
    likely = [
        one
        for one in tried[:CONTENDERS]
        if one.opened[-1] in hypotheses.effects and hypotheses.log_evidence(one) > least
    ]
    # A law is exact or off by its tolerance, each as likely before: the better of both stands.
    rough = {one.opened[-1]: one for one in hypotheses.with_laws(likely)}
    tried = [max(one, rough.get(one.opened[-1], one), key=hypotheses.log_evidence) for one in tried]
    without = hypotheses.log_evidence(base)
    odds = {
        one.opened[-1]: hypotheses.log_evidence(one) - without + prior(hypotheses, one.opened[-1])
        for one in tried
    }
    return _ordered(base, tried, odds)


def _ordered(base: Hypothesis, tried: list[Hypothesis], odds: dict[str, float]) -> Trial:
    ordered = sorted(tried, key=lambda one: odds[one.opened[-1]], reverse=True)
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
    for one in trial.tried[:CONTENDERS]:
        if odds[one.opened[-1]] > max(0.0, top - BEHIND):
            odds[one.opened[-1]] += gained(one) - without
    return _ordered(trial.base, list(trial.tried), odds)


def prior(hypotheses: Hypotheses, name: str) -> float:
    """Return the log of the prior odds that a bench departs by one more name."""
    if name in hypotheses.discrepancies:
        return log(UNNAMED / (len(hypotheses.discrepancies) * len(AMPLITUDES)))
    return log(EFFECTS_MISSING / len(hypotheses.effects))


def _pruned(hypotheses: Hypotheses, best: Hypothesis) -> Hypothesis:
    """Return the hypothesis without members that later ones made unnecessary."""
    for name in best.opened[:-1]:
        less = hypotheses.without(best, name)
        gained = hypotheses.log_evidence(best) - hypotheses.log_evidence(less)
        if gained + prior(hypotheses, name) <= 0.0:
            return _pruned(hypotheses, less)
    return best
