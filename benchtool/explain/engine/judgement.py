"""Results of a search for missing effects, before formatting."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from benchtool.explain.engine.held_out import ValidationScore
from benchtool.explain.engine.hypotheses import Hypothesis
from benchtool.explain.engine.verdict import Kind, UnnamedEffect

Progress = Callable[[str, float], None]  # progress(task, completed share)
CLASS_FROM = 0.05  # min probability of a class member; assumed


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Trial:
    """Candidates for one missing effect, the others given."""

    base: Hypothesis  # without the effect
    tried: tuple[Hypothesis, ...]  # the base with each candidate added, most probable first
    log_odds: Mapping[str, float] = field(default_factory=dict)  # over the base, prior included

    @property
    def name(self) -> str:
        """Name of the most probable candidate."""
        return self.tried[0].active[-1]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class CandidateEffect:
    """Candidate that an experiment is to separate from others."""

    name: str  # an effect, "none" or "unknown"
    phrase: str  # within a sentence
    fit: Hypothesis
    probability: float


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Judgement:
    """Result of the search, with probabilities."""

    kind: Kind
    null: Hypothesis
    best: Hypothesis
    predicted: Hypothesis  # for predictions: named effects, else the nearest one or the null
    score: ValidationScore
    trials: Sequence[Trial]
    weights: Sequence[Mapping[str, float]]  # of each trial: all effects, "none", "unknown"
    members: Sequence[tuple[int, str]]  # index of trial, name; of each named effect
    unknown: float  # probability of an unnamed effect
    unnamed: Sequence[UnnamedEffect] = ()
    other_effects: Sequence[tuple[str, float]] = ()  # effects in other stages, with probabilities
