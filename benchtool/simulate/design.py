"""Designs: which points a campaign runs, as a grid or at random, and under how many seeds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from math import isfinite, prod

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.plural import pluralize

MAX_RUNS = 10_000_000  # about an hour of pitch runs; a slip of the keys asks for more; assumed


@dataclass(frozen=True, slots=True)
class VariedParameter:
    """Vary one number from `lower` to `upper`; `count` values in a grid."""

    name: str
    lower: float
    upper: float
    count: int

    def __post_init__(self) -> None:
        if self.lower > self.upper or (self.lower == self.upper) != (self.count == 1):
            raise InputError(
                f"{self.name} from {self.lower:g} to {self.upper:g} in {self.count} values is no "
                f"range; give FROM below TO and a COUNT of 2 or more (or FROM equal to TO, COUNT 1)"
            )

    @classmethod
    def read(cls, text: str) -> VariedParameter:
        """Return what `NAME=FROM:TO:COUNT` says."""
        name, _, rest = text.partition("=")
        parts = rest.split(":")
        try:
            lower, upper, count = float(parts[0]), float(parts[1]), int(parts[2])
        except (ValueError, IndexError):
            count = 0
            lower = upper = float("nan")
        if len(parts) != 3 or not name or not (isfinite(lower) and isfinite(upper)) or count < 1:
            raise InputError(f"--vary got {text!r}; write NAME=FROM:TO:COUNT, as K_b=1.5:2.5:11")
        return cls(name.strip(), lower, upper, count)

    def values(self) -> list[float]:
        """Return the grid."""
        return [float(value) for value in np.linspace(self.lower, self.upper, self.count)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """Say which points are run.

    Attributes:
        samples: that many random points within the ranges in place of the grid; 0 is the grid.
        seeds: under how many noises each point is run.
    """

    varied: tuple[VariedParameter, ...]
    samples: int = 0
    seeds: int = 1
    seed: int = 0

    def __post_init__(self) -> None:
        names = [each.name for each in self.varied]
        if not names:
            raise InputError("a campaign varies something; add --vary NAME=FROM:TO:COUNT")
        if len(set(names)) != len(names):
            raise InputError("--vary names one number twice; give it once with the whole range")
        if self.seeds < 1 or self.samples < 0:
            raise InputError(
                f"{self.seeds} seeds and {self.samples} samples make no campaign; give 1 seed or "
                f"more, and 0 samples (a grid) or more"
            )
        if self.n_points * self.seeds > MAX_RUNS:
            raise InputError(
                f"{pluralize(self.n_points, 'point')} under {pluralize(self.seeds, 'seed')} are "
                f"{self.n_points * self.seeds} runs; give at most {MAX_RUNS}"
            )

    @classmethod
    def read(
        cls,
        words: Sequence[str],
        *,
        samples: int = 0,
        seeds: int = 1,
        seed: int = 0,
        full_name: Callable[[str], str] = str,
    ) -> Design:
        """Return the design of `NAME=FROM:TO:COUNT` words; `full_name` completes each name."""
        read = [VariedParameter.read(word) for word in words]
        varied = tuple(VariedParameter(full_name(v.name), v.lower, v.upper, v.count) for v in read)
        return cls(varied=varied, samples=samples, seeds=seeds, seed=seed)

    @property
    def n_points(self) -> int:
        """How many points there are."""
        return self.samples or prod(each.count for each in self.varied)

    @property
    def names(self) -> list[str]:
        """The varied numbers' names."""
        return [each.name for each in self.varied]

    def points(self) -> Iterator[dict[str, float]]:
        """Yield the points: the full grid, or random ones."""
        if not self.samples:
            for values in product(*(each.values() for each in self.varied)):
                yield dict(zip(self.names, values, strict=True))
            return
        rng = np.random.default_rng(self.seed)
        for _ in range(self.samples):
            yield {each.name: float(rng.uniform(each.lower, each.upper)) for each in self.varied}

    def probes(self) -> Iterator[dict[str, float]]:
        """Yield few points that show whether all can be run: corners, and every single value."""
        ends = [sorted({each.lower, each.upper}) for each in self.varied]
        for values in product(*ends):
            yield dict(zip(self.names, values, strict=True))
        lowest = {each.name: each.lower for each in self.varied}
        for each in self.varied:
            for value in each.values()[1:-1]:
                yield lowest | {each.name: value}

    def words(self) -> dict[str, str]:
        """Return the design as text by name, for the table's file."""
        ranges = {f"vary.{v.name}": f"{v.lower:g}:{v.upper:g}:{v.count}" for v in self.varied}
        return ranges | {
            "samples": str(self.samples), "seeds": str(self.seeds), "seed": str(self.seed),
        }  # fmt: skip

    def describe(self) -> str:
        """Say in words how many points there are and of what."""
        if self.samples:
            points = f"{self.samples} random points of {' and '.join(self.names)}"
        else:
            points = " x ".join(f"{each.count} {each.name}" for each in self.varied)
        return points + (f", {self.seeds} seeds" if self.seeds > 1 else "")
