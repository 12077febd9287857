"""Explanation of recordings: location of the gap, missing effects, remaining gap."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf

import numpy as np

from benchtool.core.units import Array
from benchtool.explain.engine.describe import (
    Disagreement,
    build_nearest,
    disagreements,
    estimate_parameters,
    find_effect,
    locate_gap,
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
from benchtool.explain.law_search.search import find_dependence
from benchtool.physics.catalogue import non_candidates

NO_EFFECT = ("none", "unknown")  # candidates that are not effects
NO_BOOTSTRAP = Bootstrap()
MIN_SHARE_CLOSED = 0.05  # of the gap by the nearest effect; with less it is not reported


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Explanation:
    """Verdict with its curves.

    Attributes:
        floors: (draws,) by channel, errors of a true model with exactly known parameters on the
            validation recordings.
        floors_as_learned: the same, with parameters as uncertain as after the training recordings.
    """

    verdict: Verdict
    overlays: tuple[Overlay, ...]  # by channel, on the validation recordings
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
    """Return the missing effects of a model, validated, with the next experiment.

    Args:
        draws: noise draws for the floor; at least 100 for a report.
        propose: design the next experiment, which doubles the computing time.
        sure: probability of the verdict above which no experiment is designed, except for unknown.
        minutes: longest duration of the next experiment; None for the default.
    """
    rng = np.random.default_rng(seed)
    evidence = subject.evidence
    hypotheses = Hypotheses(evidence)
    groups = evidence.groups()
    judgement = judge(subject, hypotheses, rng, draws, progress)
    kind, trials, weights = judgement.kind, judgement.trials, judgement.weights
    null, final, score = judgement.null, judgement.predicted, judgement.score
    before, after = evidence.residuals(np.vstack([null.values, final.values])).T
    progress("evaluating the verdict", 0.9)
    effects = []
    for index, name in judgement.members:
        trial, effect = trials[index], find_effect(subject, name)
        fit = with_law = next(tried for tried in trial.tried if tried.active[-1] == name)
        if not any(key.startswith(f"{name}: law") for key in fit.amplitudes):
            (with_law,) = hypotheses.add_law_discrepancies([fit])
        effects.append(
            NamedEffect(
                name=name,
                title=effect.title,
                phrase=effect.phrase,
                stage=effect.subsystem,
                probability=weights[index][name],
                parameters=estimate_parameters(subject, hypotheses, with_law, name),
                log_likelihood_ratio=0.5 * (trial.base.cost - fit.cost),
                p_value=p_value(hypotheses, trial.base, fit, bootstrap, rng),
            )
        )
    gaps = score.gaps(rng)
    where = nearest = None
    if kind != "none":
        stage = effects[0].stage if effects else None
        if judgement.unnamed and not effects:
            stage = judgement.unnamed[0].stage
        where = locate_gap(groups, before, after, stage)
    if kind == "unknown" and final is not null and final.active[-1] in hypotheses.effects:
        worst = max(gaps, key=lambda gap: gap.before / gap.floor)
        effect, share = find_effect(subject, final.active[-1]), max(0.0, worst.share_closed)
        if share > MIN_SHARE_CLOSED:
            nearest = build_nearest(
                NearestEffect(name=effect.name, phrase=effect.phrase, share_closed=share),
                subject,
                hypotheses,
                next((fit.base for fit in trials if final in fit.tried), trials[0].base),
                final,
                {gap.channel: gap.after for gap in gaps},
            )
    depends = None
    if kind == "unknown" and {effect.stage for effect in judgement.unnamed} != {"pwm_to_rpm"}:
        progress("searching for a law", 0.92)
        others = [name for name, _ in judgement.other_effects]
        summaries = subject.summarize_residuals(null.values, others)
        depends = find_dependence(summaries, evidence.model.rig.propulsion.radius_m)
    best = judgement.best
    if not effects:
        after, best = before, null
        gaps = tuple(gap.without_effects() for gap in gaps)
    data_needed = subject.free_law if kind == "class" else ""
    remarks = (*subject.remarks, data_needed) if data_needed else subject.remarks
    refused = where.stage if kind == "unknown" and where is not None else None
    verdict = Verdict(
        kind=kind,
        bench=subject.kind,
        effects=tuple(effects),
        probabilities=_probabilities(judgement),
        alternatives=tuple(
            AlternativeEffects(effect=trial.name, probabilities=chances)
            for trial, chances in zip(trials, weights, strict=True)
        ),
        where=where,
        gaps=gaps,
        nearest=nearest,
        tolerances={k.name: k.scale for k in evidence.parameters if k.effect},
        not_judged={
            name: UnjudgedEffect.below(size)
            for name, size in hypotheses.find_unjudged(null).items()
            if name not in {effect.name for effect in effects}
        }
        | {
            effect.name: UnjudgedEffect(reason="not_tried", size=inf)
            for effect in non_candidates(subject.kind)
        },
        unnamed=tuple(judgement.unnamed),
        other_effects={find_effect(subject, name).phrase: p for name, p in judgement.other_effects},
        depends=depends,
        remarks=remarks,
        next=None,
        parameters=parameters_at(evidence.model.parameters, evidence.parameters, best.values),
        window_s=subject.window_s,
        draws=draws,
    )
    if propose and (kind == "unknown" or not verdict.has_probability(sure)):
        progress("designing the next experiment", 0.95)
        candidates = select_candidates(hypotheses, judgement)
        verdict = replace(verdict, next=subject.next_experiment(candidates, rng, refused, minutes))
    progress("done", 1.0)
    return Explanation(
        verdict=verdict,
        overlays=subject.overlays(null.values, best.values),
        disagreements=disagreements(groups, before, after),
        floors=score.floor,
        floors_as_learned=score.uncertain_floor,
    )


def _probabilities(judgement: Judgement) -> dict[str, float]:
    """Return the probability of every candidate, largest of all trials; of "none" the smallest."""
    weights = judgement.weights
    effects = dict.fromkeys(
        name for by_name in weights for name in by_name if name not in NO_EFFECT
    )
    return {
        **{name: max(by_name.get(name, 0.0) for by_name in weights) for name in effects},
        "none": min(by_name["none"] for by_name in weights),
        "unknown": judgement.unknown,
    }
