"""One record with what is true of it and what a verdict says: the neutral form of a scorecard."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from math import nan, sqrt
from typing import Literal

Kind = Literal["named", "none", "pair", "outside"]
Strength = Literal["full", "weak"]
Excitation = Literal["rich", "poor"]

MOST_MEMBERS = 3  # a class of more members says too little to count
GAP_REACHED = 1.1  # floors up to which a gap counts as closed
SURE = 0.9  # a name that is stated with more than this probability is stated with confidence


@dataclass(frozen=True, slots=True, kw_only=True)
class ScoredParameter:
    """Hold one number of a rightly named effect beside its true value."""

    name: str
    value: float
    low: float
    high: float
    truth: float

    @property
    def held(self) -> bool:
        """Whether the interval holds the truth."""
        return self.low <= self.truth <= self.high


@dataclass(frozen=True, slots=True, kw_only=True)
class Scored:
    """Hold the truth of one record and the verdict on it.

    Attributes:
        truth: names of what is hidden; an outside family's name is no effect of the library.
        not_judged: effects that the verdict says this data cannot show, with the size in tolerances
            from which it would.
        true_gaps: the same of the true model, by channel, where the generator tells it.
        gaps_truly: held-out error after over the floor of noise as great as it truly is, where it
            is not what the model states, by channel.
        by_luck: share of draws of the stated noise in which a true model's error is within the
            aim; where the record was scored before that was asked, nan.
    """

    kind: Kind  # of what is hidden: named, none, pair or outside
    truth: tuple[str, ...]
    sizes: tuple[float, ...]  # of the hidden effects, in tolerances
    stage: str  # in which the hidden effect sits; "" where nobody can say
    verdict: str  # effect, several, class, none or unknown
    names: tuple[str, ...]  # in the verdict, most likely first
    probabilities: Mapping[str, float]  # of every explanation, "none" and "unknown" among them
    where: str  # stage that the verdict points at; "" for none
    gaps: Mapping[str, float]  # held-out error after over the noise floor, by channel
    seconds: float  # that the verdict took
    strength: Strength = "full"  # weak effects are smaller than twice their tolerance
    excitation: Excitation = "rich"  # of the record
    not_judged: Mapping[str, float] = field(default_factory=dict)
    confirmed: bool = False  # whether the true model's Fisher information says that a class is one
    true_gaps: Mapping[str, float] = field(default_factory=dict)
    gaps_truly: Mapping[str, float] = field(default_factory=dict)
    by_luck: float = nan
    by_learning: float = nan  # the same with its numbers as uncertain as the verdict's are
    parameters: tuple[ScoredParameter, ...] = ()  # of rightly named effects
    label: str = ""  # to find the record again ("none 17")

    @property
    def named_first(self) -> bool:
        """Whether the likeliest name is right."""
        return bool(self.names) and self.verdict != "unknown" and self.names[0] in self.truth

    @property
    def in_class(self) -> bool:
        """Whether the truth is in a declared class that counts."""
        return (
            self.verdict == "class"
            and len(self.names) <= MOST_MEMBERS
            and self.confirmed
            and any(name in self.truth for name in self.names)
        )

    @property
    def honest(self) -> bool:
        """Whether the name is right, or in a class, or the effect was said not to show.

        It must be as small as the verdict says that this data cannot show.
        """
        unseen = self.verdict == "none" and all(
            abs(size) <= self.not_judged.get(name, 0.0)
            for name, size in zip(self.truth, self.sizes, strict=True)
        )
        return self.named_first or self.in_class or unseen

    @property
    def wrong_names(self) -> tuple[str, ...]:
        """Names that a verdict states as there, and are not; of a class, all if none is right."""
        if self.verdict == "class":
            return () if set(self.names) & set(self.truth) else self.names
        return tuple(name for name in self.names if name not in self.truth)

    @property
    def confidently_wrong(self) -> bool:
        """Whether a name that is not true is stated with confidence."""
        return any(self.probabilities.get(name, 0.0) > SURE for name in self.wrong_names)

    @property
    def both_named(self) -> bool:
        """Whether both effects of a pair are named."""
        return set(self.truth) <= set(self.names)

    @property
    def answers(self) -> frozenset[str]:
        """Answers that count as right when probabilities are held against the truth.

        An effect within its tolerance is none; a weak one from outside may be either.
        """
        if self.kind == "none":
            return frozenset({"none"})
        if self.kind == "outside":
            return frozenset({"unknown", "none"} if self.strength == "weak" else {"unknown"})
        beyond = [name for name, s in zip(self.truth, self.sizes, strict=True) if abs(s) > 1.0]
        return frozenset(beyond or {"none"})

    @property
    def stated(self) -> tuple[float, bool]:
        """Return the probability of what the verdict says first, and whether it is right.

        Of a class it is that of all members together. An effect may be likely beside something
        unknown; the verdict is then unknown.
        """
        said = {"none": ("none",), "unknown": ("unknown",)}.get(self.verdict, self.names[:1])
        said = self.names if self.verdict == "class" else said
        p = sum(self.probabilities.get(name, 0.0) for name in said)
        return min(p, 1.0), any(name in self.answers for name in said)

    @property
    def given_to_truth(self) -> float:
        """Probability given to what is true."""
        return max((self.probabilities.get(name, 0.0) for name in self.answers), default=0.0)

    @property
    def brier(self) -> float:
        """Squared error of the probabilities of all explanations; 0 is best, 2 worst."""
        best = max(self.answers, key=lambda name: self.probabilities.get(name, 0.0))
        total = sum((p - (name == best)) ** 2 for name, p in self.probabilities.items())
        return total + (best not in self.probabilities)


Z_95 = 1.959964


@dataclass(frozen=True, slots=True, kw_only=True)
class Share:
    """Hold how many of a number something is true of."""

    count: int
    total: int

    @property
    def value(self) -> float:
        """The share; nan of nothing."""
        return self.count / self.total if self.total else nan

    @property
    def interval(self) -> tuple[float, float]:
        """Return the 95 % score interval (Wilson 1927)."""
        if not self.total:
            return 0.0, 1.0
        p, n, z2 = self.value, self.total, Z_95**2
        centre = (p + z2 / (2.0 * n)) / (1.0 + z2 / n)
        half = Z_95 / (1.0 + z2 / n) * sqrt(p * (1.0 - p) / n + z2 / (4.0 * n * n))
        return max(centre - half, 0.0), min(centre + half, 1.0)

    def __str__(self) -> str:
        if not self.total:
            return "none counted"
        low, high = (100.0 * end for end in self.interval)
        return f"{self.count} of {self.total}: {100.0 * self.value:.1f} % ({low:.1f} to {high:.1f})"


def share_of(holds: Iterable[bool]) -> Share:
    """Return how many are true."""
    found = list(holds)
    return Share(count=sum(found), total=len(found))
