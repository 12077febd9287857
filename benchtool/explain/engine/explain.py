"""Explanation of recordings: location of the gap, missing effects, remaining gap."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from math import inf, sqrt
from typing import Any

import numpy as np

from benchtool.core.units import Array
from benchtool.explain.engine.bounded_least_squares import PRIOR_WIDTH_FACTOR
from benchtool.explain.engine.design import CandidateEffect
from benchtool.explain.engine.evidence import EARLY, LATE, RowGroups, parameters_at
from benchtool.explain.engine.hypotheses import Hypotheses, Hypothesis
from benchtool.explain.engine.posterior import CLASS_FROM, Judgement, Posterior, Progress, judge
from benchtool.explain.engine.subject import Subject
from benchtool.explain.findings import (
    AlternativeEffects,
    ChannelGap,
    Disagreement,
    EvidenceLocation,
    FoundParameter,
    NamedEffect,
    NearestEffect,
    UnjudgedEffect,
)
from benchtool.explain.inputs import ExplainInputs
from benchtool.explain.law_search import find_dependence
from benchtool.explain.result import ALL_REGIMES, SURE, Explanation
from benchtool.physics.catalogue import non_candidates
from benchtool.physics.effects.effect import Subsystem
from benchtool.physics.model import Model

DEFAULTS: ExplainInputs = ExplainInputs()
MIN_SHARE_CLOSED = 0.05  # of the gap by the nearest effect; with less it is not reported

SIGMA_95 = 1.959964  # half width of a 95 % interval, in standard deviations
MAX_SD_RATIO = 0.7  # posterior over prior sd; a parameter above it is not determined; assumed
AT_BOUND = 0.01  # in tolerances; largest distance of a parameter at its bound
CLOCK_FACTOR = 1.1  # by which a regime of time must be denser than any other; assumed

NONE = "nothing beyond tolerance"
MAX_CANDIDATES = 6  # candidates that an experiment is designed to separate
MIN_PROBABILITY = 0.01  # of a candidate in a design


def explain(
    subject: Subject,
    inputs: ExplainInputs = DEFAULTS,
    *,
    propose: bool = True,
    minutes: float | None = None,
    progress: Progress = lambda what, share: None,
) -> Explanation:
    """Return the missing effects of a model, validated, with the next experiment.

    Args:
        inputs: seed, numbers of draws, and with a bench the required probability of the verdict.
        propose: design the next experiment, which doubles the computing time.
        minutes: longest duration of the next experiment; None for the default.
    """
    rng, evidence = np.random.default_rng(inputs.seed), subject.evidence
    groups = evidence.groups()
    judgement = judge(subject, rng, inputs.draws, progress)
    kind, search, final = judgement.kind, judgement.search, judgement.predicted
    null, best = search.null, search.best
    before, after = evidence.residuals(np.vstack([null.values, final.values])).T
    progress("evaluating the verdict", 0.9)
    effects = _name_effects(judgement, inputs, rng)
    gaps = judgement.score.gaps(rng)
    where = nearest = depends = None
    other_effects = dict[str, float]()  # in stages without an unnamed one
    if kind != "none":
        stages = [*(k.stage for k in effects), *(k.stage for k in judgement.unnamed)]
        where = locate_gap(groups, before, after, stages[0] if stages else None)
    if kind == "unknown":
        other_effects = {
            trial.name: 1.0 - trial.probabilities["none"]
            for trial in search.trials
            if trial.name in search.hypotheses.effects
            and trial.name in best.active
            and search.effects[trial.name].subsystem not in stages
        }
        nearest = _find_nearest(judgement, gaps)
        if set(stages) != {"pwm_to_rpm"}:
            progress("searching for a law", 0.92)
            summaries = subject.summarize(subject.all_evidence, null.values, tuple(other_effects))
            depends = find_dependence(summaries, evidence.model.rig.propulsion.radius_m)
    if not effects:
        after, best = before, null
        gaps = tuple(
            replace(gap, after=gap.before, after_low=gap.before_low, after_high=gap.before_high)
            for gap in gaps
        )
    data_needed = subject.free_law if kind == "class" else ""
    found = Explanation(
        kind=kind,
        bench=subject.kind,
        effects=effects,
        probabilities=_probabilities(judgement),
        alternatives=tuple(
            AlternativeEffects(effect=trial.name, probabilities=chances)
            for trial, chances in zip(search.trials, judgement.weights, strict=True)
        ),
        where=where,
        gaps=gaps,
        nearest=nearest,
        tolerances={k.name: k.scale for k in evidence.parameters if k.effect},
        not_judged={
            name: UnjudgedEffect.below(size)
            for name, size in search.hypotheses.find_unjudged(null).items()
            if name not in {effect.name for effect in effects}
        }
        | {
            effect.name: UnjudgedEffect(reason="not_tried", size=inf)
            for effect in non_candidates(subject.kind)
        },
        unnamed=tuple(judgement.unnamed),
        other_effects={search.effects[name].phrase: p for name, p in other_effects.items()},
        depends=depends,
        remarks=(*subject.remarks, *filter(None, [data_needed])),
        next=None,
        parameters=parameters_at(evidence.model.parameters, evidence.parameters, best.values),
        window_s=subject.window_s,
        draws=inputs.draws,
        overlays=subject.overlays(null.values, best.values),
        disagreements=_disagreements(groups, before, after),
        floors=judgement.score.floor,
        floors_as_learned=judgement.score.uncertain_floor,
        seed=inputs.seed,
    )
    sure = SURE if inputs.bench is None else inputs.until
    if propose and (kind == "unknown" or not found.has_probability(sure)):
        progress("designing the next experiment", 0.95)
        rivals = _select_candidates(judgement)
        refused = where.stage if kind == "unknown" and where is not None else None
        if len({rival.name for rival in rivals}) > 1:
            designer = subject.designer(subject.all_evidence, rivals, rng)
            found = replace(found, next=designer.propose(refused, minutes))
    progress("done", 1.0)
    return found


def _name_effects(
    judgement: Judgement, inputs: ExplainInputs, rng: np.random.Generator
) -> tuple[NamedEffect, ...]:
    """Return the named effects with parameters and evidence."""
    search, effects = judgement.search, []
    model = search.hypotheses.evidence.model
    for index, name in judgement.members:
        trial = search.trials[index]
        fit = with_law = next(tried for tried in trial.tried if tried.active[-1] == name)
        if not any(key.startswith(f"{name}: law") for key in fit.amplitudes):
            (with_law,) = search.hypotheses.add_law_discrepancies([fit])
        effects.append(
            NamedEffect(
                **_labels(search, trial.base, fit),
                probability=judgement.weights[index][name],
                parameters=estimate_parameters(model, search.hypotheses, with_law, name),
                p_value=search.hypotheses.p_value(trial.base, fit, inputs, rng),
            )
        )
    return tuple(effects)


def _labels(search: Posterior, base: Hypothesis, fit: Hypothesis) -> dict[str, Any]:
    """Return the fields of a named effect that follow from its fit."""
    effect = search.effects[fit.active[-1]]
    return {
        "name": effect.name, "title": effect.title, "phrase": effect.phrase,
        "stage": effect.subsystem, "log_likelihood_ratio": 0.5 * (base.cost - fit.cost),
    }  # fmt: skip


def _find_nearest(judgement: Judgement, gaps: Sequence[ChannelGap]) -> NearestEffect | None:
    """Return the effect of the prediction, if it is not the null, with the gap that it leaves."""
    fit, search = judgement.predicted, judgement.search
    hypotheses, trials = search.hypotheses, search.trials
    if fit is search.null or fit.active[-1] not in hypotheses.effects:
        return None
    share = max(0.0, max(gaps, key=lambda gap: gap.before / gap.floor).share_closed)
    if share <= MIN_SHARE_CLOSED:
        return None
    evidence = hypotheses.evidence
    base = next((trial.base for trial in trials if fit in trial.tried), trials[0].base)
    effect = NamedEffect(
        **_labels(search, base, fit),
        probability=0.0,
        parameters=estimate_parameters(evidence.model, hypotheses, fit, fit.active[-1]),
        p_value=hypotheses.p_value(base, fit, DEFAULTS, np.random.default_rng(0)),
    )
    return NearestEffect(
        effect=effect,
        share_closed=share,
        parameters=parameters_at(evidence.model.parameters, evidence.parameters, fit.values),
        after={gap.channel: gap.after for gap in gaps},
    )


def _probabilities(judgement: Judgement) -> dict[str, float]:
    """Return the probability of every candidate, largest of all trials; of "none" the smallest."""
    weights = judgement.weights
    names = dict.fromkeys(name for by_name in weights for name in by_name)
    unknown = [by_name["unknown"] for by_name in weights]
    return {
        **{
            name: max(by_name.get(name, 0.0) for by_name in weights)
            for name in names
            if name not in ("none", "unknown")
        },
        "none": min(by_name["none"] for by_name in weights),
        "unknown": max(unknown) if judgement.kind == "unknown" else min(unknown),
    }


def estimate_parameters(
    model: Model, hypotheses: Hypotheses, fit: Hypothesis, name: str
) -> tuple[FoundParameter, ...]:
    """Return an effect's parameters under a hypothesis.

    Standard deviations include the uncertainty of all other parameters within tolerance, of the
    law's shape, and of the law's scale. A parameter at its bound, or with about the sd of its
    prior, is not determined; its interval is the physical range.
    """
    posterior_sd = np.sqrt(np.diag(hypotheses.covariance(fit)))
    law = model.discrepancy.law
    effect = next(effect for effect in model.effects if effect.name == name)
    neutral = {item.name: item.neutral for item in effect.parameters}
    parameters = hypotheses.evidence.parameters
    estimates = []
    for parameter, scaled, sd in zip(parameters, fit.values, posterior_sd, strict=True):
        if parameter.effect != name:
            continue
        value = parameter.value(float(scaled))
        key = parameter.name.partition(".")[2]
        zero = neutral[key]
        reference = parameter.start if zero is None else zero
        std = float(np.hypot(sd * parameter.scale, law * (value - reference)))
        low, high = value - SIGMA_95 * std, value + SIGMA_95 * std
        margin = AT_BOUND * parameter.scale
        inside = parameter.lower + margin < value < parameter.upper - margin
        within = low > parameter.lower or high < parameter.upper
        determined = inside and within and float(sd) < MAX_SD_RATIO * PRIOR_WIDTH_FACTOR
        if not determined and np.isfinite(parameter.upper - parameter.lower):
            low, high = parameter.lower, parameter.upper
            std = (high - low) / sqrt(12.0)
        estimates.append(
            FoundParameter(
                name=key,
                unit=parameter.unit,
                value=value,
                std=std,
                low=max(low, parameter.lower),
                high=min(high, parameter.upper),
                tolerance=parameter.scale,
                neutral=reference,
                determined=determined,
            )
        )
    return tuple(estimates)


def locate_gap(
    groups: RowGroups, before: Array, after: Array, stage: Subsystem | None
) -> EvidenceLocation | None:
    """Return stage and regime of the largest residuals.

    The regime has the densest gain; a regime of time only if it is clearly denser than others.

    Args:
        before: (n_rows,) residuals within tolerance.
        after: (n_rows,) residuals with the named or the nearest effect.
        stage: of the named effect; None: from the rows.
    """
    sizes = {name: _rms(before[mask]) for name, mask in groups.stages.items()}
    location: Subsystem = stage if stage is not None else max(sizes, key=lambda name: sizes[name])
    rows = groups.stages.get(location)
    if rows is None:
        rows = ~groups.stages.get("pwm_to_rpm", np.zeros(len(before), bool))
    gained = np.where(rows, before**2 - after**2, 0.0)
    if gained.sum() <= 0.0:  # no gain: use the excess over the noise
        gained = np.where(rows, before**2 - 1.0, 0.0)
    total = gained.sum()
    best, max_density = ALL_REGIMES, 1.5
    for name, mask in groups.regimes.items():
        inside = gained[mask].sum() / total if total > 0.0 else 0.0
        dense = inside / max(float(np.mean(mask[rows])), 1e-9)
        if name in (LATE, EARLY):
            dense /= CLOCK_FACTOR
        if inside > 0.3 and dense > max_density:
            best, max_density = name, dense
    mask = groups.regimes.get(best, np.ones(len(before), bool)) & rows
    return EvidenceLocation(
        stage=location,
        regime=best,
        size=_rms(before[mask]),
        share=float(gained[mask].sum() / total) if total > 0.0 else 0.0,
    )


def _disagreements(groups: RowGroups, before: Array, after: Array) -> tuple[Disagreement, ...]:
    """Return residuals by stage and regime, before and after (n_rows,) each."""
    masks = {ALL_REGIMES: np.ones(len(before), bool), **groups.regimes}
    return tuple(
        Disagreement(
            stage=stage,
            by_regime={name: _rms(before[mask & rows]) for name, mask in masks.items()},
            after={name: _rms(after[mask & rows]) for name, mask in masks.items()},
        )
        for stage, rows in groups.stages.items()
        if rows.any()
    )


def _rms(rows: Array) -> float:
    return float(np.sqrt(np.mean(rows**2))) if len(rows) else 0.0


def _select_candidates(judgement: Judgement) -> list[CandidateEffect]:
    """Return the candidates that an experiment should separate, most probable first.

    At least two, with a joint probability of 95 %, of the least certain trial.
    """
    hypotheses = judgement.search.hypotheses
    pairs = zip(judgement.search.trials, judgement.weights, strict=True)
    trial, _ = min(pairs, key=lambda pair: max(pair[1].values()))
    by_name = trial.probabilities
    phrases = {effect.name: effect.phrase for effect in hypotheses.evidence.model.effects}
    phrases |= {name: part.phrase for name, part in hypotheses.discrepancies.items()}
    fits = {"none": trial.base, **{fit.active[-1]: fit for fit in trial.tried}}
    phrases["none"] = NONE
    names, remaining = list[str](), 1.0
    for name in sorted(fits, key=lambda name: -by_name.get(name, 0.0))[:MAX_CANDIDATES]:
        if len(names) < 2 or remaining > CLASS_FROM:
            names.append(name)
            remaining -= by_name.get(name, 0.0)
    has_named = any(name not in hypotheses.discrepancies for name in names)
    return [
        CandidateEffect(
            name="unknown" if has_named and name in hypotheses.discrepancies else name,
            phrase=phrases[name],
            fit=fits[name],
            probability=max(by_name.get(name, 0.0), MIN_PROBABILITY),
        )
        for name in names
    ]
