"""Verdict of an explanation: location, effects, gap, next experiment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from math import inf
from typing import Literal

from benchtool.core.parameter import Parameters
from benchtool.core.schedule import Schedule
from benchtool.explain.law_search.law import FoundDependence
from benchtool.physics.effects.effect import BenchKind, Subsystem

STAGE_TITLES: dict[Subsystem, str] = {  # for headings and cells
    "pwm_to_rpm": "from pwm to rpm",
    "rpm_to_thrust": "from rpm to thrust",
    "hinge": "hinge",
    "sensor": "sensor",
    "plate": "plate",
}

STAGE_LOCATIONS = {  # within a sentence
    "pwm_to_rpm": "between pulse and rotor speed",
    "rpm_to_thrust": "between rotor speed and thrust",
    "hinge": "at the hinge",
    "sensor": "in the sensors",
    "plate": "at the plate",
}

Kind = Literal["effect", "several", "class", "none", "unknown"]
KINDS: tuple[Kind, ...] = ("effect", "several", "class", "none", "unknown")
Unjudged = Literal["too_weak", "no_trace", "not_tried"]  # size: larger; none; no candidate
ALL_REGIMES = "everywhere"  # regime of a gap that is similar in all regimes
SURE, LIKELY = 0.9, 0.7  # min probabilities of "lacks" and of "probably lacks"; assumed
EXCESS_ERROR = 1.5  # in noise floors; a larger remaining error is reported; assumed
MIN_DETECTABLE = 3.0  # tolerances; an effect with a larger detection limit counts as unjudged
UNDETECTABLE = 100.0  # tolerances; an effect with a larger detection limit leaves no trace
DECISION_PROBABILITY = 1.0  # min expected log evidence ratio of a decisive experiment; assumed


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundParameter:
    """Parameter of a named effect."""

    name: str  # without the effect ("torque_Nm")
    unit: str  # of all values
    value: float  # most probable value
    std: float  # standard deviation, with all other effects free within their tolerances
    low: float  # of a 95 % interval; if not determined, of the physical range
    high: float
    tolerance: float
    neutral: float  # value without the effect
    determined: bool = True  # False: the data do not reduce the physical range

    @property
    def text(self) -> str:
        """Value with standard deviation and unit."""
        if not self.determined:
            return f"not determined ({self.low:.3g} to {self.high:.3g})"
        return f"{self.value:.4g} ± {self.std:.2g} {self.unit}".removesuffix(" 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedEffect:
    """Effect named by an explanation."""

    name: str  # in the library
    title: str
    phrase: str  # the title within a sentence
    stage: Subsystem
    probability: float  # of the effect beyond its tolerance
    parameters: tuple[FoundParameter, ...]
    log_likelihood_ratio: float  # against the same model with the effect within its tolerance
    p_value: float  # of that ratio under the null


@dataclass(frozen=True, slots=True, kw_only=True)
class AlternativeEffects:
    """Alternatives to one named effect, the other effects given."""

    effect: str  # the most probable one
    probabilities: Mapping[str, float]  # of every effect, "none" and "unknown"; they sum to 1


@dataclass(frozen=True, slots=True, kw_only=True)
class EvidenceLocation:
    """Location of the gap between model and measurement."""

    stage: Subsystem
    regime: str  # part of the recording with the densest gap, as text
    size: float  # rms of residuals there, in standard deviations of the stated noise
    share: float  # of the whole gap in this regime


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelGap:
    """Prediction error of one channel on the validation recordings, root mean square.

    Intervals before and after are 95 % of a block bootstrap over windows.
    """

    channel: str
    unit: str  # of all values
    as_given: float  # of the model file
    before: float  # of the model adjusted within uncertainties and tolerances
    after: float  # with the named effects added; equal to `before` without any
    floor: float  # of a true model, median over draws of the stated noise
    floor_low: float
    floor_high: float
    before_low: float
    before_high: float
    after_low: float
    after_high: float

    def without_effects(self) -> ChannelGap:
        """Return the gap with the errors after set to those before, if no effect is named."""
        low, high = self.before_low, self.before_high
        return replace(self, after=self.before, after_low=low, after_high=high)

    @property
    def share_closed(self) -> float:
        """Share of the gap above the floor closed by the named effects; 0 without a gap."""
        total = self.before**2 - self.floor**2
        if total <= 0.0:
            return 0.0
        return (self.before**2 - self.after**2) / total


@dataclass(frozen=True, slots=True, kw_only=True)
class NearestEffect:
    """Effect that explains most of an unnamed effect."""

    name: str
    phrase: str
    share_closed: float
    effect: NamedEffect | None = None  # with its best parameters; None if not fitted
    parameters: Parameters = field(default_factory=lambda: Parameters(()))
    after: Mapping[str, float] = field(default_factory=dict)  # validation errors by channel


@dataclass(frozen=True, slots=True, kw_only=True)
class UnnamedEffect:
    """Discrepancy beyond tolerance that no effect explains."""

    name: str
    stage: Subsystem
    phrase: str  # within a sentence
    probability: float
    share: float  # largest size, as a share of the reading
    tolerances: float  # the same in tolerances
    weight: float  # sum of squared residuals explained

    @property
    def text(self) -> str:
        """Description with size."""
        size = f"{100.0 * self.share:.2g} % of the reading ({self.tolerances:.1f} tolerances)"
        return f"{self.phrase}, up to {size}"


@dataclass(frozen=True, slots=True, kw_only=True)
class UnjudgedEffect:
    """Effect that the data cannot detect."""

    reason: Unjudged
    size: float  # detection limit in tolerances; inf if undetectable

    @classmethod
    def below(cls, size: float) -> UnjudgedEffect:
        """Return an unjudged effect with its detection limit in tolerances."""
        if size > UNDETECTABLE:
            return cls(reason="no_trace", size=inf)
        return cls(reason="too_weak", size=size)


@dataclass(frozen=True, slots=True, kw_only=True)
class NextExperiment:
    """Proposed next experiment."""

    candidates: tuple[str, ...]  # to be separated, most probable first
    title: str  # one line
    reason: str  # why the experiment separates them
    schedule: Schedule | None  # commands of a pitch experiment; None for a sweep
    plan_toml: str  # of a sweep; "" for a pitch experiment
    expected: Mapping[str, float]  # log evidence ratios of the first over each other candidate
    minutes: float = 0.0  # duration

    @property
    def is_decisive(self) -> bool:
        """True if it should separate the most probable candidate from another."""
        return max(self.expected.values()) >= DECISION_PROBABILITY


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Verdict of an explanation."""

    kind: Kind
    bench: BenchKind
    effects: tuple[NamedEffect, ...]  # named effects or members of a class, most probable first
    probabilities: Mapping[str, float]  # of all candidates, "none" and "unknown"
    alternatives: tuple[AlternativeEffects, ...]  # one for each of several named effects, else one
    where: EvidenceLocation | None  # location of the gap; None without a gap
    gaps: tuple[ChannelGap, ...]  # one per channel
    nearest: NearestEffect | None  # for an unknown
    tolerances: Mapping[str, float]  # by full name of a parameter
    unnamed: tuple[UnnamedEffect, ...]  # in any stage, largest first
    other_effects: Mapping[str, float]  # probabilities of effects in other stages, by phrase
    not_judged: Mapping[str, UnjudgedEffect]  # by name
    remarks: tuple[str, ...]  # repairs of the recordings, and missing columns
    next: NextExperiment | None  # for a class or an unknown
    parameters: Parameters  # of the model with the named effects
    window_s: float  # length of a prediction window
    draws: int = field(default=0)  # noise draws for the floor
    depends: FoundDependence | None = None  # law of an unknown effect, if found

    @property
    def stages(self) -> Mapping[Subsystem, str]:
        """Missing effects of each stage, as text."""
        phrases: dict[Subsystem, list[str]] = {}
        for effect in self.effects:
            text = f"{effect.phrase}, probability {effect.probability:.2f}"
            phrases.setdefault(effect.stage, []).append(text)
        for unnamed in self.unnamed:
            phrases.setdefault(unnamed.stage, []).append(unnamed.text)
        return {stage: "; ".join(parts) for stage, parts in phrases.items()}

    @property
    def n_tried_and_unjudged(self) -> tuple[int, int]:
        """Numbers of tried effects and of unjudged ones among them."""
        tried = {name.partition(".")[0] for name in self.tolerances}
        unjudged = {name for name, e in self.not_judged.items() if e.size > MIN_DETECTABLE}
        return len(tried), len(tried & unjudged)

    @property
    def is_mostly_unjudged(self) -> bool:
        """True if most effects are unjudged."""
        n_tried, n_unjudged = self.n_tried_and_unjudged
        return 2 * n_unjudged > n_tried

    @property
    def is_sure(self) -> bool:
        """True if all named effects are probable enough."""
        return self.kind in ("effect", "several") and all(
            effect.probability >= SURE for effect in self.effects
        )

    def has_probability(self, probability: float) -> bool:
        """Return True if every named effect has this probability or more; False for a class."""
        if self.kind in ("none", "unknown"):
            return self.probabilities[self.kind] >= probability
        return self.kind != "class" and all(
            effect.probability >= probability for effect in self.effects
        )

    @property
    def remaining_error(self) -> float:
        """Largest validation error with the named effects, in noise floors."""
        return max((gap.after / gap.floor for gap in self.gaps if gap.floor > 0.0), default=0.0)

    @property
    def class_members(self) -> tuple[str, ...]:
        """Names of a class, with "unknown" if it has an unnamed effect or one name only."""
        if self.kind != "class":
            return ()
        unknown = ("unknown",) if self.unnamed or len(self.names) == 1 else ()
        return (*self.names, *unknown)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects in the verdict."""
        return tuple(effect.name for effect in self.effects)

    @property
    def sentence(self) -> str:
        """The verdict in one sentence."""
        return _SENTENCES[self.kind](self)


def _effect(effect: NamedEffect) -> str:
    numbers = [
        f"{effect.name}.{parameter.name} {'= ' if parameter.determined else ''}{parameter.text}"
        for parameter in effect.parameters
    ]
    return f"{effect.phrase}: {', '.join(numbers)}"


def _format_probability(probability: float) -> str:
    text = f"{probability:.2f}"
    return "above 0.99" if text == "1.00" else text


def _verb(probability: float) -> str:
    if probability >= SURE:
        return "lacks"
    return "probably lacks" if probability >= LIKELY else "may lack"


def _effects_sentence(verdict: Verdict) -> str:
    """Return each effect with its probability; equal verbs are not repeated."""
    last_verb, parts = "", list[str]()
    for effect in verdict.effects:
        probability, verb = _format_probability(effect.probability), _verb(effect.probability)
        prefix = "" if verb == last_verb else f"{verb} "
        parts.append(f"{prefix}{_effect(effect)}, probability {probability}")
        last_verb = verb
    return f"The model {'; and '.join(parts)}{_excess(verdict)}."


def _excess(verdict: Verdict) -> str:
    """Return a phrase for a remaining error above the noise floor."""
    if verdict.remaining_error <= EXCESS_ERROR:
        return ""
    return f"; the remaining error is {verdict.remaining_error:.1f} noise floors"


def _class(verdict: Verdict) -> str:
    effect, *others = verdict.effects
    text = f"{_effect(effect)}, probability {_format_probability(effect.probability)}"
    if not others and verdict.remaining_error > EXCESS_ERROR:
        return f"The missing effect is mostly similar to {text}{_excess(verdict)}."
    if not others and not verdict.unnamed:
        return (
            f"The model {_verb(effect.probability)} {text}, or lacks a similar effect with a "
            f"different law; this data cannot separate them."
        )
    probability = sum(effect.probability for effect in verdict.effects)
    members = [effect.phrase for effect in verdict.effects]
    if verdict.unnamed:  # it may be the only missing effect
        probability = max(unnamed.probability for unnamed in verdict.unnamed)
        members.append(verdict.unnamed[0].text)
    return (
        f"The model {_verb(probability)} one of {', '.join(members)}; this data cannot separate "
        f"them; the most probable named effect is {_effect(effect)}{_excess(verdict)}."
    )


def _none(verdict: Verdict) -> str:
    n_tried, n_unjudged = verdict.n_tried_and_unjudged
    excess = _excess(verdict)
    if verdict.is_mostly_unjudged:
        return (
            f"This data can show only {n_tried - n_unjudged} of {n_tried} effects, and none of "
            f"those is missing from the model beyond its tolerance{excess}."
        )
    limits = f"; {n_unjudged} of {n_tried} effects were not judged" if n_unjudged else ""
    return f"Nothing beyond the stated tolerances is missing from the model{limits}{excess}."


def _unknown(verdict: Verdict) -> str:
    location = nearest = ""
    if (where := verdict.where) is not None:
        regime = "" if where.regime == ALL_REGIMES else f" ({where.regime})"
        location = f" {STAGE_LOCATIONS[where.stage]}{regime}"
    if (effect := verdict.nearest) is not None:
        share = f"{100.0 * effect.share_closed:.0f} % of the gap"
        nearest = f"; the nearest is {effect.phrase}, which closes {share}"
    detail = f": {verdict.unnamed[0].text}" if verdict.unnamed else ""
    if not (detail or nearest):
        detail = _excess(verdict)
    for phrase, probability in verdict.other_effects.items():
        nearest += f"; also {phrase}, probability {_format_probability(probability)}"
    law = f"; it {verdict.depends.text}" if verdict.depends is not None else ""
    return f"Something is missing{location} that no named effect explains{detail}{law}{nearest}."


_SENTENCES = {
    "effect": _effects_sentence,
    "several": _effects_sentence,
    "class": _class,
    "none": _none,
    "unknown": _unknown,
}
