"""Explain recordings: where a model disagrees with them, which effect is missing, what is left."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from benchtool.core.array import Array
from benchtool.explain.engine.describe import (
    Disagreement,
    disagreements,
    effect_of,
    fitted_nearest,
    found_parameters,
    leftover,
    where_shown,
)
from benchtool.explain.engine.held_out import HeldOut
from benchtool.explain.engine.hypotheses import Hypotheses, Hypothesis, p_value
from benchtool.explain.engine.parameters import parameters_at
from benchtool.explain.engine.search import Progress, Search, accepted, closing, searched, weighed
from benchtool.explain.engine.subject import Overlay, Subject
from benchtool.explain.engine.verdict import Kind, NamedEffect, Nearest, NotJudged, Rivals, Verdict
from benchtool.fit.identifiability import CANNOT_TELL

HOPELESS = 2.0
"""Variance left, over what the bench allows, from which a hypothesis is refused with certainty."""

NO_EFFECT = ("none", "unknown")
"""Explanations that name no effect."""

CLASS_FROM = 0.05
"""A rival for the same place that is likelier than this makes a class with the best, if the best
model's own information says that such data cannot tell the two apart."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Explanation:
    """Hold a verdict and the curves behind it.

    Attributes:
        floors: (draws,) by channel, what a true model misses on the check recordings, its numbers
            known exactly.
        floors_as_learned: the same, the truth as far from its numbers as the recordings to learn
            from leave them uncertain.
    """

    verdict: Verdict
    overlays: tuple[Overlay, ...]  # by channel, on the check recordings
    disagreements: tuple[Disagreement, ...]  # by stage
    floors: Mapping[str, Array] = field(default_factory=dict)
    floors_as_learned: Mapping[str, Array] = field(default_factory=dict)


def explain(
    subject: Subject,
    *,
    seed: int = 0,
    draws: int = 128,
    bootstrap: int = 0,
    propose: bool = True,
    progress: Progress = lambda what, share: None,
) -> Explanation:
    """Return what is missing from a subject's model, and what the check recordings say to it.

    Args:
        subject: recordings against a model.
        seed: of the noise behind floors and intervals.
        draws: of the noise behind the floor, 100 at least for a report.
        bootstrap: records drawn from the null for p-values; asymptotic ones when 0.
        propose: whether to work out the next experiment, which takes as long as all the rest.
        progress: called with what is being done.
    """
    rng = np.random.default_rng(seed)
    evidence = subject.evidence
    hypotheses = Hypotheses(evidence)
    groups = evidence.groups()

    def left(one: Hypothesis) -> float:
        """Return the variance of what a hypothesis leaves, over what the bench allows."""
        rows = evidence.residuals(one.at[None])[:, 0]
        return leftover(groups, rows) / subject.allowed_leftover(one.at, rng)

    search = searched(hypotheses, progress, lambda one: left(one) > HOPELESS)
    progress("predicting the check recordings", 0.7)
    if len(search.trials) > 1:
        search = closing(subject, hypotheses, search)
    null, best = search.null, search.best
    held = HeldOut.of(subject, hypotheses, null, best, rng, draws)
    before, after = evidence.residuals(np.vstack([null.at, best.at])).T
    null_is_noise = best_is_noise = accepted(held.ratio(0), left(null))
    if best is not null:
        best_is_noise = accepted(held.ratio(1), left(best), held.closed / subject.closed_enough)
    weights = [
        weighed(
            trial.gains,
            hypotheses.dispersion(trial.tried[0]),
            best_is_noise,
            null_is_noise,
            subject.temperature,
        )
        for trial in search.trials
    ]
    kind, members = _decided(hypotheses, search, weights[0])
    progress("drawing the answer", 0.9)
    effects = []
    for place, name in members:
        trial, effect = search.trials[place], effect_of(subject, name)
        one = next(tried for tried in trial.tried if tried.opened[-1] == name)
        effects.append(
            NamedEffect(
                name=name,
                title=effect.title,
                phrase=effect.phrase,
                stage=effect.subsystem,
                probability=weights[place][name],
                parameters=found_parameters(subject, hypotheses, one, name),
                log_likelihood_ratio=0.5 * (trial.base.cost - one.cost),
                p_value=p_value(hypotheses, trial.base, one, bootstrap, rng),
            )
        )
    gaps = held.gaps(rng)
    where = nearest = None
    if kind != "none":
        where = where_shown(groups, before, after, effects[0].stage if effects else None)
    if kind == "unknown":
        worst = max(gaps, key=lambda gap: gap.before / gap.floor)
        effect = effect_of(subject, search.trials[0].name)
        share = max(0.0, worst.share_closed)
        nearest = Nearest(name=effect.name, phrase=effect.phrase, share_closed=share)
        near = best if best.opened else search.trials[0].tried[0]
        missed = subject.errors(near.at[None])
        after_it = {name: float(np.sqrt(np.mean(one.squares))) for name, one in missed.items()}
        base = search.trials[0].base
        nearest = fitted_nearest(nearest, subject, hypotheses, base, near, after_it)
    if not effects:
        after, best = before, null
        gaps = tuple(
            replace(
                gap, after=gap.before, after_low=gap.before_low, after_high=gap.before_high
            )
            for gap in gaps
        )  # fmt: skip
    rivals = _rivals(search, kind, members)
    refused = where.stage if kind == "unknown" and where is not None else None
    verdict = Verdict(
        kind=kind,
        bench=subject.kind,
        effects=tuple(effects),
        probabilities=_probabilities(weights),
        places=tuple(
            Rivals(effect=trial.name, probabilities=one)
            for trial, one in zip(search.trials, weights, strict=True)
        ),
        where=where,
        gaps=gaps,
        nearest=nearest,
        tolerances={k.name: k.scale for k in evidence.parameters if k.effect},
        not_judged={
            name: NotJudged.below(size)
            for name, size in hypotheses.unseen(null).items()
            if name not in {effect.name for effect in effects}
        },
        remarks=subject.remarks,
        next=subject.next_experiment(rivals, rng, refused) if rivals and propose else None,
        parameters=parameters_at(evidence.model.parameters, evidence.parameters, best.at),
        window_s=subject.window_s,
        draws=draws,
    )
    progress("done", 1.0)
    return Explanation(
        verdict=verdict,
        overlays=subject.overlays(null.at, best.at),
        disagreements=disagreements(groups, before, after),
        floors=held.floor,
        floors_as_learned=held.doubt[1],
    )


def _decided(
    hypotheses: Hypotheses, search: Search, first: Mapping[str, float]
) -> tuple[Kind, list[tuple[int, str]]]:
    """Return the kind of verdict and its members: (place, effect) each.

    A class is what this data did not tell apart, and such data could not be expected to.
    """
    named = {name: value for name, value in first.items() if name not in NO_EFFECT}
    total = sum(named.values())
    if first["unknown"] > max(first["none"], total):
        return "unknown", []
    if not search.best.opened:
        return "none", []
    if len(search.best.opened) > 1:
        return "several", [(place, trial.name) for place, trial in enumerate(search.trials)]
    best, *others = sorted(named, key=lambda name: -named[name])
    likely = [name for name in others if named[name] > CLASS_FROM * total]
    truth = next(one for one in search.trials[0].tried if one.opened[-1] == best)
    members = [best] + [
        name for name in likely if hypotheses.evidence_against(truth, name) < CANNOT_TELL
    ]
    return "effect" if len(members) == 1 else "class", [(0, name) for name in members]


def _probabilities(weights: list[dict[str, float]]) -> dict[str, float]:
    """Return the probability of every explanation; where effects join, of each for its place."""
    named = dict.fromkeys(name for one in weights for name in one if name not in NO_EFFECT)
    return {
        **{name: max(one.get(name, 0.0) for one in weights) for name in named},
        "none": min(one["none"] for one in weights),
        "unknown": weights[0]["unknown"],
    }


def _rivals(search: Search, kind: Kind, members: list[tuple[int, str]]) -> list[tuple[str, Array]]:
    """Return the hypotheses that a next experiment should separate."""
    trial = search.trials[0]
    if kind == "class":
        names = {name for _, name in members}
        return [(one.opened[-1], one.at) for one in trial.tried if one.opened[-1] in names]
    if kind == "unknown":
        return [(one.opened[-1], one.at) for one in trial.tried[:2]]
    return []
