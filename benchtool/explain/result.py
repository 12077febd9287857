"""Result of an explanation: the verdict with its evidence, gap, curves and provenance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from benchtool.core.parameter import Parameters
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.explain.findings import (
    AlternativeEffects,
    ChannelGap,
    Disagreement,
    EvidenceLocation,
    NamedEffect,
    NearestEffect,
    NextExperiment,
    Overlay,
    UnjudgedEffect,
    UnnamedEffect,
)
from benchtool.explain.laws import FoundDependence
from benchtool.physics.effects.effect import BenchKind, Subsystem

if TYPE_CHECKING:
    from benchtool.explain.request import Request

STAGE_LOCATIONS = {  # within a sentence
    "pwm_to_rpm": "between pulse and rotor speed",
    "rpm_to_thrust": "between rotor speed and thrust",
    "hinge": "at the hinge",
    "sensor": "in the sensors",
    "plate": "at the plate",
}

Kind = Literal["effect", "several", "class", "none", "unknown"]
ALL_REGIMES = "everywhere"  # regime of a gap that is similar in all regimes
SURE, LIKELY = 0.9, 0.7  # min probabilities of "lacks" and of "probably lacks"; assumed
EXCESS_ERROR = 1.5  # in noise floors; a larger remaining error is reported; assumed
MIN_DETECTABLE = 3.0  # tolerances; an effect with a larger detection limit counts as unjudged


@dataclass(frozen=True, slots=True, eq=False, kw_only=True, repr=False)
class Explanation:
    """Missing effects of a model, with probabilities, remaining gap and next experiment."""

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
    window_s: float  # length of a prediction window; 0 for steady-state predictions
    draws: int  # noise draws for the floor
    depends: FoundDependence | None = None  # law of an unknown effect, if found
    overlays: tuple[Overlay, ...] = ()  # by channel, on the validation recordings
    disagreements: tuple[Disagreement, ...] = ()  # by stage
    floors: Mapping[str, Array] = field(default_factory=dict)  # (draws,) validation errors of a
    # true model by channel, with exactly known parameters
    floors_as_learned: Mapping[str, Array] = field(default_factory=dict)  # with learned parameters
    source: Request | None = None  # recordings and model; None for recordings in memory
    seed: int = 0  # of all random draws
    seconds: float = 0.0  # computing time
    commands: tuple[str, ...] = ()  # as typed

    def __repr__(self) -> str:
        return self.sentence

    @property
    def request(self) -> Request:
        """Recordings and model, read from files."""
        assert self.source is not None
        return self.source

    @property
    def simulated(self) -> bool:
        """True if any recording is simulated."""
        return any(source.recording.simulated for source in self.request.sources)

    def find_title(self, name: str) -> str:
        """Return an effect's title, or the name if it has no title ("none")."""
        effects = self.request.effects
        return effects[name].title if name in effects else name

    @property
    def caution(self) -> str:
        """Caution about the recordings; empty without warnings."""
        if not self.remarks:
            return ""
        first, *others = self.remarks
        hint = f" ({pluralize(len(others), 'more remark')} in the list of unjudged effects)"
        return f"Caution: {first.rstrip('.')}{hint if others else ''}."

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
        return self.kind in ("effect", "several") and self.has_probability(SURE)

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


def _effects_sentence(found: Explanation) -> str:
    """Return each effect with its probability; equal verbs are not repeated."""
    last_verb, parts = "", list[str]()
    for effect in found.effects:
        probability, verb = _format_probability(effect.probability), _verb(effect.probability)
        prefix = "" if verb == last_verb else f"{verb} "
        parts.append(f"{prefix}{_effect(effect)}, probability {probability}")
        last_verb = verb
    return f"The model {'; and '.join(parts)}{_excess(found)}."


def _excess(found: Explanation) -> str:
    """Return a phrase for a remaining error above the noise floor."""
    if found.remaining_error <= EXCESS_ERROR:
        return ""
    return f"; the remaining error is {found.remaining_error:.1f} noise floors"


def _class(found: Explanation) -> str:
    effect, *others = found.effects
    text = f"{_effect(effect)}, probability {_format_probability(effect.probability)}"
    if not others and found.remaining_error > EXCESS_ERROR:
        return f"The missing effect is mostly similar to {text}{_excess(found)}."
    if not others and not found.unnamed:
        return (
            f"The model {_verb(effect.probability)} {text}, or lacks a similar effect with a "
            f"different law; this data cannot separate them."
        )
    probability = sum(effect.probability for effect in found.effects)
    members = [effect.phrase for effect in found.effects]
    if found.unnamed:  # it may be the only missing effect
        probability = max(unnamed.probability for unnamed in found.unnamed)
        members.append(found.unnamed[0].text)
    return (
        f"The model {_verb(probability)} one of {', '.join(members)}; this data cannot separate "
        f"them; the most probable named effect is {_effect(effect)}{_excess(found)}."
    )


def _none(found: Explanation) -> str:
    n_tried, n_unjudged = found.n_tried_and_unjudged
    excess = _excess(found)
    if found.is_mostly_unjudged:
        return (
            f"This data can show only {n_tried - n_unjudged} of {n_tried} effects, and none of "
            f"those is missing from the model beyond its tolerance{excess}."
        )
    limits = f"; {n_unjudged} of {n_tried} effects were not judged" if n_unjudged else ""
    return f"Nothing beyond the stated tolerances is missing from the model{limits}{excess}."


def _unknown(found: Explanation) -> str:
    location = nearest = ""
    if (where := found.where) is not None:
        regime = "" if where.regime == ALL_REGIMES else f" ({where.regime})"
        location = f" {STAGE_LOCATIONS[where.stage]}{regime}"
    if found.nearest is not None:
        share = f"{100.0 * found.nearest.share_closed:.0f} % of the gap"
        nearest = f"; the nearest is {found.nearest.effect.phrase}, which closes {share}"
    detail = f": {found.unnamed[0].text}" if found.unnamed else ""
    if not (detail or nearest):
        detail = _excess(found)
    for phrase, probability in found.other_effects.items():
        nearest += f"; also {phrase}, probability {_format_probability(probability)}"
    law = f"; it {found.depends.text}" if found.depends is not None else ""
    return f"Something is missing{location} that no named effect explains{detail}{law}{nearest}."


_SENTENCES = {
    "effect": _effects_sentence,
    "several": _effects_sentence,
    "class": _class,
    "none": _none,
    "unknown": _unknown,
}
