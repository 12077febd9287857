"""Explain recordings: where a model disagrees with them, which effect is missing, what is left."""

from __future__ import annotations

import numpy as np

from benchtool.core.array import Array
from benchtool.explain.engine.describe import (
    disagreements,
    effect_of,
    found_parameters,
    leftover,
    where_shown,
)
from benchtool.explain.engine.explanation import Explanation, TrueMisses
from benchtool.explain.engine.held_out import HeldOut
from benchtool.explain.engine.hypotheses import Hypotheses, Hypothesis, p_value
from benchtool.explain.engine.parameters import parameters_at
from benchtool.explain.engine.search import Progress, Search, closing, searched
from benchtool.explain.engine.subject import Subject
from benchtool.explain.engine.verdict import Kind, NamedEffect, Nearest, NotJudged, Rivals, Verdict
from benchtool.explain.engine.weigh import Fit, Weighed, weighed
from benchtool.fit.identifiability import CANNOT_TELL

HOPELESS = 2.0
"""Variance left, over what the bench allows, from which a hypothesis is refused with certainty."""

CLASS_FROM = 0.05
"""A rival for the same place that is likelier than this makes a class with the best, if the best
model's own information says that such data cannot tell the two apart."""


def explain(
    subject: Subject,
    *,
    seed: int = 0,
    draws: int = 128,
    bootstrap: int = 0,
    propose: bool = True,
    progress: Progress | None = None,
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
    report = progress if progress is not None else _silent
    rng = np.random.default_rng(seed)
    evidence = subject.evidence
    hypotheses = Hypotheses(evidence)
    groups = evidence.groups()

    def left(one: Hypothesis) -> float:
        """Return the variance of what a hypothesis leaves, over what the bench allows."""
        rows = evidence.residuals(one.at[None])[:, 0]
        return leftover(groups, rows) / subject.allowed_leftover(one.at, rng)

    search = searched(hypotheses, report, lambda one: left(one) > HOPELESS)
    report("predicting the check recordings", 0.7)
    if len(search.slots) > 1:
        search = closing(subject, hypotheses, search)
    null, best = search.null, search.best
    held = HeldOut.of(subject, hypotheses, null, best, rng, draws)
    rows = evidence.residuals(np.vstack([null.at, best.at]))
    without = Fit(ratio=held.ratio(0), leftover=left(null))
    fit = without
    if best is not null:
        closed = held.closed(2) / subject.closed_enough
        fit = Fit(ratio=held.ratio(1), leftover=left(best), closed=closed)
    weights = [
        weighed(slot.gains, hypotheses.dispersion(slot.tried[0]), fit, without, subject.temperature)
        for slot in search.slots
    ]
    kind, members = _decided(hypotheses, search, weights)
    report("drawing the answer", 0.9)
    effects = tuple(
        NamedEffect(
            name=name,
            title=effect_of(subject, name).title,
            stage=effect_of(subject, name).subsystem,
            probability=weights[place].named[name],
            parameters=found_parameters(subject, hypotheses, one, name),
            log_likelihood_ratio=0.5 * (search.slots[place].base.cost - one.cost),
            p_value=p_value(hypotheses, search.slots[place].base, one, bootstrap, rng),
        )
        for place, name, one in (
            (place, name, next(t for t in search.slots[place].tried if t.opened[-1] == name))
            for place, name in members
        )
    )
    final = best.at if effects else null.at
    where = None
    if kind != "none":
        where = where_shown(groups, rows[:, 0], rows[:, 1], effects[0].stage if effects else None)
    nearest = None
    if kind == "unknown":
        name = search.slots[0].name
        title = effect_of(subject, name).title
        nearest = Nearest(name=name, title=title, share_closed=max(0.0, held.share_closed))
    rivals = _rivals(search, kind, members)
    verdict = Verdict(
        kind=kind,
        bench=subject.kind,
        effects=effects,
        probabilities=_probabilities(weights),
        places=_places(search, weights),
        where=where,
        gaps=held.gaps(bool(effects), rng),
        nearest=nearest,
        tolerances={k.name: k.scale for k in evidence.parameters if k.effect},
        not_judged={
            name: NotJudged.below(size)
            for name, size in hypotheses.unseen(null).items()
            if name not in {effect.name for effect in effects}
        },
        remarks=subject.remarks,
        next=subject.next_experiment(rivals, rng) if rivals and propose else None,
        parameters=parameters_at(evidence.model.parameters, evidence.parameters, final),
        window_s=subject.window_s,
        draws=draws,
    )
    report("done", 1.0)
    return Explanation(
        verdict=verdict,
        overlays=subject.overlays(null.at, final),
        disagreements=disagreements(groups, rows[:, 0], rows[:, 1] if effects else rows[:, 0]),
        true_misses=TrueMisses(known=held.floor, learned=held.doubt[1]),
    )


def _silent(what: str, share: float) -> None:
    """Say nothing."""


def _decided(
    hypotheses: Hypotheses, search: Search, weights: list[Weighed]
) -> tuple[Kind, list[tuple[int, str]]]:
    """Return the kind of verdict and its members: (place, effect) each.

    A class is what this data did not tell apart, and such data could not be expected to.
    """
    first = weights[0]
    if first.unknown > max(first.none, sum(first.named.values())):
        return "unknown", []
    if not search.best.opened:
        return "none", []
    if len(search.best.opened) > 1:
        return "several", [(place, slot.name) for place, slot in enumerate(search.slots)]
    total = sum(first.named.values())
    best, *others = sorted(first.named, key=lambda name: -first.named[name])
    likely = [name for name in others if first.named[name] > CLASS_FROM * total]
    truth = next(one for one in search.slots[0].tried if one.opened[-1] == best)
    members = [best] + [
        name for name in likely if hypotheses.evidence_against(truth, name) < CANNOT_TELL
    ]
    return "effect" if len(members) == 1 else "class", [(0, name) for name in members]


def _probabilities(weights: list[Weighed]) -> dict[str, float]:
    """Return the probability of every explanation; where effects join, of each for its place."""
    out: dict[str, float] = {}
    for one in weights:
        for name, value in one.named.items():
            out[name] = max(out.get(name, 0.0), value)
    return {**out, "none": min(w.none for w in weights), "unknown": weights[0].unknown}


def _places(search: Search, weights: list[Weighed]) -> tuple[Rivals, ...]:
    """Return the probabilities of every explanation for each place."""
    return tuple(
        Rivals(
            effect=slot.name,
            probabilities={**one.named, "none": one.none, "unknown": one.unknown},
        )
        for slot, one in zip(search.slots, weights, strict=True)
    )


def _rivals(search: Search, kind: Kind, members: list[tuple[int, str]]) -> list[tuple[str, Array]]:
    """Return the hypotheses that a next experiment should separate."""
    slot = search.slots[0]
    if kind == "class":
        names = {name for _, name in members}
        return [(one.opened[-1], one.at) for one in slot.tried if one.opened[-1] in names]
    if kind == "unknown":
        return [(one.opened[-1], one.at) for one in slot.tried[:2]]
    return []
