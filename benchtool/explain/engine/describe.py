"""Description of hypotheses: parameters with intervals, location of the gap."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.explain.engine.evidence import EARLY, LATE, RowGroups, Subject
from benchtool.explain.engine.hypotheses import Bootstrap, Hypotheses, Hypothesis, p_value
from benchtool.explain.engine.parameters import parameters_at
from benchtool.explain.engine.shared_errors import PRIOR_WIDTH_FACTOR
from benchtool.explain.engine.verdict import (
    EvidenceLocation,
    FoundParameter,
    NamedEffect,
    NearestEffect,
)
from benchtool.physics.effects.effect import Effect, Subsystem

SIGMA_95 = 1.959964  # half width of a 95 % interval, in standard deviations
MAX_SD_RATIO = 0.7  # posterior over prior sd; a parameter above it is not determined; assumed
AT_BOUND = 0.01  # in tolerances; largest distance of a parameter at its bound
CLOCK_FACTOR = 1.1  # by which a regime of time must be denser than any other; assumed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Disagreement:
    """Residuals by regime, for the figure."""

    stage: Subsystem
    by_regime: Mapping[str, float]  # root mean square of the whitened residuals; 1 is noise
    after: Mapping[str, float]  # the same with the named effects


def find_effect(subject: Subject, name: str) -> Effect:
    """Return an effect of the subject's model by name."""
    return next(effect for effect in subject.evidence.model.effects if effect.name == name)


def estimate_parameters(
    subject: Subject, hypotheses: Hypotheses, fit: Hypothesis, name: str
) -> tuple[FoundParameter, ...]:
    """Return an effect's parameters under a hypothesis.

    Standard deviations include the uncertainty of all other parameters within tolerance, of the
    law's shape, and of the law's scale. A parameter at its bound, or with about the sd of its
    prior, is not determined; its interval is the physical range.
    """
    posterior_sd = np.sqrt(np.diag(hypotheses.covariance(fit)))
    law = subject.evidence.model.discrepancy.law
    effect = find_effect(subject, name)
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


def build_nearest(
    nearest: NearestEffect,
    subject: Subject,
    hypotheses: Hypotheses,
    base: Hypothesis,
    fit: Hypothesis,
    after: Mapping[str, float],
) -> NearestEffect:
    """Return the nearest effect with its parameters and validation errors by channel (`after`)."""
    effect = find_effect(subject, nearest.name)
    named = NamedEffect(
        name=effect.name, title=effect.title, phrase=effect.phrase, stage=effect.subsystem,
        probability=0.0, parameters=estimate_parameters(subject, hypotheses, fit, effect.name),
        log_likelihood_ratio=0.5 * (base.cost - fit.cost),
        p_value=p_value(hypotheses, base, fit, Bootstrap(), np.random.default_rng(0)),
    )  # fmt: skip
    evidence = subject.evidence
    parameters = parameters_at(evidence.model.parameters, evidence.parameters, fit.values)
    return replace(nearest, effect=named, parameters=parameters, after=after)


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
    location: Subsystem = stage if stage is not None else largest_disagreement(groups, before)
    rows = groups.stages.get(location)
    if rows is None:
        rows = ~groups.stages.get("pwm_to_rpm", np.zeros(len(before), bool))
    gained = np.where(rows, before**2 - after**2, 0.0)
    if gained.sum() <= 0.0:  # no gain: use the excess over the noise
        gained = np.where(rows, before**2 - 1.0, 0.0)
    total = gained.sum()
    best, max_density = "everywhere", 1.5
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


def largest_disagreement(groups: RowGroups, residuals: Array) -> Subsystem:
    """Return the stage with the largest root mean square of residuals."""
    return max(groups.stages, key=lambda stage: _rms(residuals[groups.stages[stage]]))


def disagreements(groups: RowGroups, before: Array, after: Array) -> tuple[Disagreement, ...]:
    """Return residuals by stage and regime, before and after (n_rows,) each."""
    result = []
    for stage, rows in groups.stages.items():
        if not rows.any():
            continue
        masks: dict[str, NDArray[np.bool_]] = {"everywhere": np.ones(len(rows), bool)}
        masks |= groups.regimes
        by_regime = {name: _rms(before[mask & rows]) for name, mask in masks.items()}
        after_by_regime = {name: _rms(after[mask & rows]) for name, mask in masks.items()}
        result.append(Disagreement(stage=stage, by_regime=by_regime, after=after_by_regime))
    return tuple(result)


def _rms(rows: Array) -> float:
    return float(np.sqrt(np.mean(rows**2))) if len(rows) else 0.0
