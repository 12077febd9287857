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

STAGES: dict[Subsystem, str] = {  # as a heading or a cell has them
    "pwm_to_rpm": "from pwm to rpm",
    "rpm_to_thrust": "from rpm to thrust",
    "hinge": "hinge",
    "sensor": "sensor",
    "plate": "plate",
}

PLACES = {  # as a sentence says where something is
    "pwm_to_rpm": "between pulse and rotor speed",
    "rpm_to_thrust": "between rotor speed and thrust",
    "hinge": "at the hinge",
    "sensor": "in the sensors",
    "plate": "at the plate",
}


Kind = Literal["effect", "several", "class", "none", "unknown"]
KINDS: tuple[Kind, ...] = ("effect", "several", "class", "none", "unknown")
Unjudged = Literal["too_weak", "no_trace", "not_tried"]  # size: larger; none; no candidate
EVERYWHERE = "everywhere"  # regime of a disagreement that is alike in all parts
SURE, LIKELY = 0.9, 0.7  # probabilities of "lacks" and of "probably lacks"; assumed
EXCESS_ERROR = 1.5  # in noise floors; a larger remaining error is reported; assumed
MIN_DETECTABLE = 3.0  # tolerances; an effect that needs more to show makes the data blind for it
UNDETECTABLE = 100.0  # tolerances; an effect that needs more leaves no trace
DECISION_PROBABILITY = (
    1.0  # an experiment with a smaller expected log evidence ratio decides nothing; assumed
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundParameter:
    """Parameter of a named effect.

    Attributes:
        determined: whether the data say more of it than the range that physics leaves it.
    """

    name: str  # the parameter's own name ("torque_Nm")
    unit: str  # of all numbers here
    value: float  # most likely value
    std: float  # standard deviation of it; other effects are free within their tolerances meanwhile
    low: float
    high: float
    tolerance: float  # what would not have mattered
    neutral: float  # value at which the effect is absent
    determined: bool = True

    @property
    def text(self) -> str:
        """The number with its standard deviation and unit."""
        if not self.determined:
            return f"not determined ({self.low:.3g} to {self.high:.3g})"
        return f"{self.value:.4g} ± {self.std:.2g} {self.unit}".removesuffix(" 1")


@dataclass(frozen=True, slots=True, kw_only=True)
class NamedEffect:
    """Effect named by an explanation."""

    name: str  # as in the catalogue
    title: str  # for people
    phrase: str  # the title as it stands within a sentence
    stage: Subsystem  # of the chain
    probability: float  # that this effect is there, beyond its tolerance
    parameters: tuple[FoundParameter, ...]  # its numbers
    log_likelihood_ratio: float  # against the same model with the effect held within its tolerance
    p_value: float  # of that ratio when nothing beyond tolerance is there


@dataclass(frozen=True, slots=True, kw_only=True)
class AlternativeEffects:
    """Alternatives to one named effect, the other effects given."""

    effect: str  # the likeliest one
    probabilities: Mapping[str, float]  # of every effect, "none" and "unknown"; they sum to 1


@dataclass(frozen=True, slots=True, kw_only=True)
class EvidenceLocation:
    """Location of the gap between model and measurement."""

    stage: Subsystem  # link of the chain
    regime: str  # part of the recording in which it shows most, in words
    size: float  # how far residuals stand out there, in standard deviations of the stated noise
    share: float  # part of the whole disagreement that lies in this regime


@dataclass(frozen=True, slots=True, kw_only=True)
class ChannelGap:
    """Prediction error of one channel on the validation recordings, root mean square.

    Attributes:
        before_low, before_high, after_low, after_high: 95 % of a block bootstrap over windows.
    """

    channel: str  # its name
    unit: str  # of all numbers here
    as_given: float  # of the model as its file states it
    before: float  # after what the file calls uncertain or too small to matter was used up
    after: float  # with the named effects added; equal to `before` where nothing is named
    floor: float  # what a true model would miss, median over draws of the stated noise
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
        """Part of the gap above the floor that the named effects close; 0 without a gap."""
        total = self.before**2 - self.floor**2
        if total <= 0.0:
            return 0.0
        return (self.before**2 - self.after**2) / total


@dataclass(frozen=True, slots=True, kw_only=True)
class NearestEffect:
    """Effect that explains most of an unnamed effect.

    Attributes:
        effect: with the numbers that it would have; None where it was not fitted.
        after: by channel, the prediction error that it would leave on the check recordings.
    """

    name: str
    phrase: str
    share_closed: float
    effect: NamedEffect | None = None
    parameters: Parameters = field(default_factory=lambda: Parameters(()))
    after: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class UnnamedEffect:
    """Discrepancy beyond tolerance that no effect explains."""

    name: str
    stage: Subsystem  # of the chain
    phrase: str  # what it depends on
    probability: float
    share: float  # how large it becomes, over the reading
    tolerances: float  # the same in tolerances
    weight: float  # sum of squares that it takes up

    @property
    def text(self) -> str:
        """Description with size."""
        return (
            f"{self.phrase}, up to {100.0 * self.share:.2g} % of the reading "
            f"({self.tolerances:.1f} tolerances)"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class UnjudgedEffect:
    """Effect that the data cannot detect."""

    reason: Unjudged  # why
    size: float  # how large it would have to be to show, in tolerances; inf where no size would do

    @classmethod
    def below(cls, size: float) -> UnjudgedEffect:
        """Return it for an effect that shows from so many tolerances on."""
        if size > UNDETECTABLE:
            return cls(reason="no_trace", size=inf)
        return cls(reason="too_weak", size=size)


@dataclass(frozen=True, slots=True, kw_only=True)
class NextExperiment:
    """Proposed next experiment.

    Attributes:
        expected: log evidence ratio that it is expected to bring between the likeliest candidate
            and each other one, by that one, the likeliest first.
    """

    candidates: tuple[str, ...]  # the explanations that it is to separate, likeliest first
    title: str  # what to do, one line
    reason: str  # why that separates them
    schedule: Schedule | None  # commands of a pitch experiment; None for a sweep
    plan_toml: str  # a sweep's plan; "" for a pitch experiment
    expected: Mapping[str, float]
    minutes: float = 0.0  # how long it takes

    @property
    def decides(self) -> bool:
        """True if it should separate the most probable candidate from another."""
        return max(self.expected.values()) >= DECISION_PROBABILITY


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """Verdict of an explanation.

    Attributes:
        probabilities: of every explanation that was weighed, "none" and "unknown" among them; of
            several effects the greatest over their places.
        places: the same for each place, one for each named effect of several, else one.
    """

    kind: Kind  # effect, several, class, none or unknown
    bench: BenchKind  # pitch or sweep
    effects: tuple[NamedEffect, ...]  # named effects; of a class its members, most likely first
    probabilities: Mapping[str, float]
    places: tuple[AlternativeEffects, ...]
    where: EvidenceLocation | None  # where the disagreement is; None where there is none
    gaps: tuple[ChannelGap, ...]  # of the check recordings, one per channel
    nearest: NearestEffect | None  # for an unknown, the named effect that comes nearest
    tolerances: Mapping[str, float]  # what does not matter, by parameter's full name
    unnamed: tuple[UnnamedEffect, ...]  # what has no name, in any stage, the largest first
    beside: Mapping[str, float]  # phrases of effects that are there beside an unknown, how likely
    not_judged: Mapping[str, UnjudgedEffect]  # effects that this data cannot show, by name
    remarks: tuple[str, ...]  # what was repaired in the recordings, and what they lack
    next: NextExperiment | None  # the next experiment, for a class or an unknown
    parameters: Parameters  # of the model with the named effects in it
    window_s: float  # length of a prediction window
    draws: int = field(default=0)  # draws behind the floor
    depends: FoundDependence | None = None  # what an unknown depends on, where that was found

    @property
    def stages(self) -> Mapping[Subsystem, str]:
        """Missing effects of each stage, as text."""
        phrases: dict[Subsystem, list[str]] = {}
        for effect in self.effects:
            text = f"{effect.phrase}, probability {effect.probability:.2f}"
            phrases.setdefault(effect.stage, []).append(text)
        for departure in self.unnamed:
            phrases.setdefault(departure.stage, []).append(departure.text)
        return {stage: "; ".join(parts) for stage, parts in phrases.items()}

    @property
    def tried_and_blind(self) -> tuple[int, int]:
        """Numbers of tried effects and of unjudged ones among them."""
        tried = {name.partition(".")[0] for name in self.tolerances}
        blind = {
            name for name, unjudged in self.not_judged.items() if unjudged.size > MIN_DETECTABLE
        }
        return len(tried), len(tried & blind)

    @property
    def mostly_blind(self) -> bool:
        """True if most effects are unjudged."""
        tried, blind = self.tried_and_blind
        return 2 * blind > tried

    @property
    def is_sure(self) -> bool:
        """True if all named effects are probable enough."""
        return self.kind in ("effect", "several") and all(
            effect.probability >= SURE for effect in self.effects
        )

    def holds(self, probability: float) -> bool:
        """Return whether the verdict has this probability; False for a class."""
        if self.kind in ("none", "unknown"):
            return self.probabilities[self.kind] >= probability
        return self.kind != "class" and all(
            effect.probability >= probability for effect in self.effects
        )

    @property
    def left(self) -> float:
        """The largest error on the check recordings after what is named, over its floor."""
        return max((gap.after / gap.floor for gap in self.gaps if gap.floor > 0.0), default=0.0)

    @property
    def class_members(self) -> tuple[str, ...]:
        """Names of a class, "unknown" among them where something without a name is."""
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
        f"{effect.name}.{item.name} {'= ' if item.determined else ''}{item.text}"
        for item in effect.parameters
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
    """Return each effect with its probability; the verb once for those as sure."""
    last_verb, parts = "", list[str]()
    for effect in verdict.effects:
        chance, verb = _format_probability(effect.probability), _verb(effect.probability)
        part = f"{'' if verb == last_verb else f'{verb} '}{_effect(effect)}, probability {chance}"
        parts.append(part)
        last_verb = verb
    return f"The model {'; and '.join(parts)}{_excess(verdict)}."


def _excess(verdict: Verdict) -> str:
    """Return a phrase for a remaining error above the noise floor."""
    if verdict.left <= EXCESS_ERROR:
        return ""
    return f"; {verdict.left:.1f} times what noise explains is left"


def _class(verdict: Verdict) -> str:
    effect, *others = verdict.effects
    text = f"{_effect(effect)}, probability {_format_probability(effect.probability)}"
    if not others and verdict.left > EXCESS_ERROR:
        return f"What the model lacks is mostly like {text}{_excess(verdict)}."
    if not others and not verdict.unnamed:
        return (
            f"The model {_verb(effect.probability)} {text}, or lacks something that looks like "
            f"it by a different law; this data cannot separate them."
        )
    together = sum(effect.probability for effect in verdict.effects)
    members = [effect.phrase for effect in verdict.effects]
    if verdict.unnamed:  # something without a name that may as well be all there is
        together = max(departure.probability for departure in verdict.unnamed)
        members.append(verdict.unnamed[0].text)
    return (
        f"The model {_verb(together)} one of {', '.join(members)}; this data cannot separate "
        f"them; of the named the likeliest is {_effect(verdict.effects[0])}{_excess(verdict)}."
    )


def _none(verdict: Verdict) -> str:
    tried, blind = verdict.tried_and_blind
    if verdict.mostly_blind:
        return (
            f"This data can show only {tried - blind} of {tried} effects, and none of "
            f"those is missing from the model beyond its tolerance{_excess(verdict)}."
        )
    limits = f"; {blind} of {tried} effects were not judged" if blind else ""
    return (
        f"Nothing beyond the stated tolerances is missing from the model{limits}{_excess(verdict)}."
    )


def _unknown(verdict: Verdict) -> str:
    location = nearest = ""
    if (where := verdict.where) is not None:
        everywhere = where.regime == EVERYWHERE
        location = f" {PLACES[where.stage]}" + ("" if everywhere else f" ({where.regime})")
    if (effect := verdict.nearest) is not None:
        share = f"{100.0 * effect.share_closed:.0f} % of the gap"
        nearest = f"; the nearest is {effect.phrase}, which closes {share}"
    detail = f": {verdict.unnamed[0].text}" if verdict.unnamed else ""
    if not (detail or nearest):
        detail = _excess(verdict)
    for phrase, probability in verdict.beside.items():
        nearest += f"; beside it {phrase}, probability {_format_probability(probability)}"
    depends = f"; it {verdict.depends.text}" if verdict.depends is not None else ""
    return (
        f"Something is missing{location} that no named effect explains{detail}{depends}{nearest}."
    )


_SENTENCES = {
    "effect": _effects_sentence,
    "several": _effects_sentence,
    "class": _class,
    "none": _none,
    "unknown": _unknown,
}
