"""What a search for missing effects comes to, before it is put into words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from benchtool.explain.engine.held_out import ValidationScore
from benchtool.explain.engine.hypotheses import Hypothesis
from benchtool.explain.engine.verdict import Kind, UnnamedEffect

Progress = Callable[[str, float], None]  # progress(what is being done, share of the whole)
CLASS_FROM = 0.05  # probability of a rival from which it can make a class; assumed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Trial:
    """Hold one place of an explanation and everything that was tried in it."""

    base: Hypothesis  # the hypothesis without it
    tried: tuple[Hypothesis, ...]  # the base with each other name opened, likeliest first
    log_odds: Mapping[str, float] = field(default_factory=dict)  # over the base, prior included

    @property
    def name(self) -> str:
        """The likeliest for the place."""
        return self.tried[0].active[-1]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CandidateEffect:
    """Hold one explanation that an experiment is to separate from others."""

    name: str  # an effect, "none" or "unknown"
    phrase: str  # as it stands within a sentence
    fit: Hypothesis
    probability: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Judgement:
    """Hold what was found, and how likely it is.

    Attributes:
        weights: for each trial, probabilities of every effect, of "none" and of "unknown".
        members: (place, effect) of each effect that is named.
        shown: the hypothesis whose predictions are shown, be it named or the nearest.
    """

    kind: Kind
    null: Hypothesis
    best: Hypothesis
    shown: Hypothesis
    held: ValidationScore
    trials: Sequence[Trial]
    weights: Sequence[Mapping[str, float]]
    members: Sequence[tuple[int, str]]
    unknown: float  # probability that something without a name is missing
    unnamed: Sequence[UnnamedEffect] = ()
    beside: Sequence[tuple[str, float]] = ()  # effects with their probabilities beside an unknown
