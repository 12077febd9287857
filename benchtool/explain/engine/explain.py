"""Explanation of recordings: location of the gap, missing effects, remaining gap."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from benchtool.core.array_type import Array
from benchtool.explain.engine.describe import (
    Disagreement,
    disagreements,
    effect_size,
    fitted_nearest,
    found_parameters,
    where_shown,
)
from benchtool.explain.engine.design import select_candidates
from benchtool.explain.engine.evidence import Overlay, Subject
from benchtool.explain.engine.hypotheses import Bootstrap, Hypotheses, p_value
from benchtool.explain.engine.judgement import Judgement, Progress
from benchtool.explain.engine.parameters import parameters_at
from benchtool.explain.engine.posterior import judge
from benchtool.explain.engine.verdict import (
    SURE,
    AlternativeEffects,
    NamedEffect,
    NearestEffect,
    UnjudgedEffect,
    Verdict,
)
from benchtool.explain.law_search.search import dependence
from benchtool.physics.catalogue import never_tried

NO_EFFECT = ("none", "unknown")  # explanations that name no effect

NO_BOOTSTRAP = Bootstrap()

CLOSES = 0.05  # the nearest effect is mentioned from this share of the gap on


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Explanation:
    """Verdict with its curves.

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
    bootstrap: Bootstrap = NO_BOOTSTRAP,
    propose: bool = True,
    sure: float = SURE,
    minutes: float | None = None,
    progress: Progress = lambda what, share: None,
) -> Explanation:
    """Return what is missing from a subject's model, and what the check recordings say to it.

    Args:
        draws: of the noise behind the floor, 100 at least for a report.
        bootstrap: records drawn from the null for p-values; asymptotic ones when none.
        propose: whether to design the next experiment, which takes as long as all the rest.
        sure: probability of the answer from which no experiment is needed, but for an unknown.
        minutes: that the next experiment may take; a usual time when None.
    """
    rng = np.random.default_rng(seed)
    evidence = subject.evidence
    hypotheses = Hypotheses(evidence)
    groups = evidence.groups()
    judgement = judge(subject, hypotheses, rng, draws, progress)
    kind, trials, weights = judgement.kind, judgement.trials, judgement.weights
    null, final, held = judgement.null, judgement.shown, judgement.held
    before, after = evidence.residuals(np.vstack([null.values, final.values])).T
    progress("drawing the answer", 0.9)
    effects = []
    for index, name in judgement.members:
        trial, effect = trials[index], effect_size(subject, name)
        fit = next(tried for tried in trial.tried if tried.active[-1] == name)
        with_law = fit
        if not any(key.startswith(f"{name}: law") for key in fit.amplitudes):
            (with_law,) = hypotheses.add_law_discrepancies([fit])
        effects.append(
            NamedEffect(
                name=name,
                title=effect.title,
                phrase=effect.phrase,
                stage=effect.subsystem,
                probability=weights[index][name],
                parameters=found_parameters(subject, hypotheses, with_law, name),
                log_likelihood_ratio=0.5 * (trial.base.cost - fit.cost),
                p_value=p_value(hypotheses, trial.base, fit, bootstrap, rng),
            )
        )
    gaps = held.gaps(rng)
    where = nearest = None
    if kind != "none":
        stage = effects[0].stage if effects else None
        if judgement.unnamed and not effects:
            stage = judgement.unnamed[0].stage
        where = where_shown(groups, before, after, stage)
    if kind == "unknown" and final is not null and final.active[-1] in hypotheses.effects:
        worst = max(gaps, key=lambda gap: gap.before / gap.floor)
        effect, share = effect_size(subject, final.active[-1]), max(0.0, worst.share_closed)
        if share > CLOSES:
            nearest = fitted_nearest(
                NearestEffect(name=effect.name, phrase=effect.phrase, share_closed=share),
                subject,
                hypotheses,
                next((fit.base for fit in trials if final in fit.tried), trials[0].base),
                final,
                {gap.channel: gap.after for gap in gaps},
            )
    depends = None
    if kind == "unknown" and {departure.stage for departure in judgement.unnamed} != {"pwm_to_rpm"}:
        progress("looking for what it depends on", 0.92)
        missed = subject.missing_channels(null.values, [name for name, _ in judgement.beside])
        depends = dependence(missed, evidence.model.rig.propulsion.radius_m)
    best = judgement.best
    if not effects:
        after, best = before, null
        gaps = tuple(
            replace(
                gap, after=gap.before, after_low=gap.before_low, after_high=gap.before_high
            )
            for gap in gaps
        )  # fmt: skip
    needed = subject.free_law if kind == "class" else ""
    remarks = (*subject.remarks, needed) if needed else subject.remarks
    refused = where.stage if kind == "unknown" and where is not None else None
    verdict = Verdict(
        kind=kind,
        bench=subject.kind,
        effects=tuple(effects),
        probabilities=_probabilities(judgement),
        places=tuple(
            AlternativeEffects(effect=trial.name, probabilities=chances)
            for trial, chances in zip(trials, weights, strict=True)
        ),
        where=where,
        gaps=gaps,
        nearest=nearest,
        tolerances={k.name: k.scale for k in evidence.parameters if k.effect},
        not_judged={
            name: UnjudgedEffect.below(size)
            for name, size in hypotheses.unseen(null).items()
            if name not in {effect.name for effect in effects}
        }
        | {
            effect.name: UnjudgedEffect(reason="not_tried", size=inf)
            for effect in never_tried(subject.kind)
        },
        unnamed=tuple(judgement.unnamed),
        beside={
            effect_size(subject, name).phrase: probability for name, probability in judgement.beside
        },
        depends=depends,
        remarks=remarks,
        next=None,
        parameters=parameters_at(evidence.model.parameters, evidence.parameters, best.values),
        window_s=subject.window_s,
        draws=draws,
    )
    if propose and (kind == "unknown" or not verdict.holds(sure)):
        progress("designing the next experiment", 0.95)
        among = select_candidates(hypotheses, judgement)
        verdict = replace(verdict, next=subject.next_experiment(among, rng, refused, minutes))
    progress("done", 1.0)
    return Explanation(
        verdict=verdict,
        overlays=subject.overlays(null.values, best.values),
        disagreements=disagreements(groups, before, after),
        floors=held.floor,
        floors_as_learned=held.doubt,
    )


def _probabilities(judgement: Judgement) -> dict[str, float]:
    """Return the probability of every explanation; where effects join, of each for its place."""
    weights = judgement.weights
    named = dict.fromkeys(name for chances in weights for name in chances if name not in NO_EFFECT)
    return {
        **{name: max(chances.get(name, 0.0) for chances in weights) for name in named},
        "none": min(chances["none"] for chances in weights),
        "unknown": judgement.unknown,
    }
