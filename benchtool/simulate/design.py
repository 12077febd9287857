"""Design of a campaign: points in a grid or at random, and number of seeds."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import isfinite, prod

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.text import pluralize

MAX_RUNS = 10_000_000  # about an hour of pitch runs; larger designs are typing errors; assumed


@dataclass(frozen=True, slots=True)
class VariedParameter:
    """Parameter varied from `lower` to `upper`, with `count` values in a grid."""

    name: str
    lower: float
    upper: float
    count: int

    def __post_init__(self) -> None:
        if self.lower > self.upper or (self.lower == self.upper) != (self.count == 1):
            raise InputError(
                f"range of {self.name} is invalid: {self.lower:g} to {self.upper:g}, {self.count} "
                f"values; allowed: FROM below TO and COUNT from 2, or FROM equal to TO and COUNT 1"
            )

    @classmethod
    def read(cls, text: str) -> VariedParameter:
        """Return the varied parameter in the text `NAME=FROM:TO:COUNT`."""
        name, _, numbers = text.partition("=")
        parts = numbers.split(":")
        try:
            lower, upper, count = float(parts[0]), float(parts[1]), int(parts[2])
        except (ValueError, IndexError):
            count = 0
            lower = upper = float("nan")
        if len(parts) != 3 or not name or not (isfinite(lower) and isfinite(upper)) or count < 1:
            raise InputError(f"--vary got {text!r}; write NAME=FROM:TO:COUNT, such as K_b=1:2:11")
        return cls(name.strip(), lower, upper, count)

    def values(self) -> list[float]:
        """Return the values of the grid."""
        return [float(value) for value in np.linspace(self.lower, self.upper, self.count)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """Points of a campaign.

    Attributes:
        samples: number of random points within the ranges; 0 means the grid.
        seeds: number of noise seeds per point.
    """

    varied: tuple[VariedParameter, ...]
    samples: int = 0
    seeds: int = 1
    seed: int = 0

    def __post_init__(self) -> None:
        names = [parameter.name for parameter in self.varied]
        if not names:
            raise InputError("a campaign needs a varied parameter; add --vary NAME=FROM:TO:COUNT")
        if len(set(names)) != len(names):
            raise InputError("a parameter occurs twice in --vary; give it once")
        if self.seeds < 1 or self.samples < 0:
            raise InputError(
                f"{self.seeds} seeds and {self.samples} samples are out of range; allowed: seeds "
                f"from 1, samples from 0 (a grid)"
            )
        if self.n_points * self.seeds > MAX_RUNS:
            raise InputError(
                f"{pluralize(self.n_points, 'point')} with {pluralize(self.seeds, 'seed')} are "
                f"{self.n_points * self.seeds} runs; allowed: up to {MAX_RUNS}"
            )

    @classmethod
    def read(
        cls,
        texts: Sequence[str],
        *,
        samples: int = 0,
        seeds: int = 1,
        seed: int = 0,
        full_name: Callable[[str], str] = str,
    ) -> Design:
        """Return the design of `NAME=FROM:TO:COUNT` texts; `full_name` completes each name."""
        parameters = [VariedParameter.read(text) for text in texts]
        varied = tuple(replace(v, name=full_name(v.name)) for v in parameters)
        return cls(varied=varied, samples=samples, seeds=seeds, seed=seed)

    @property
    def n_points(self) -> int:
        """Number of points."""
        return self.samples or prod(parameter.count for parameter in self.varied)

    @property
    def names(self) -> list[str]:
        """Names of the varied parameters."""
        return [parameter.name for parameter in self.varied]

    def points(self) -> Iterator[dict[str, float]]:
        """Yield the points: the full grid, or random ones."""
        if not self.samples:
            for values in product(*(parameter.values() for parameter in self.varied)):
                yield dict(zip(self.names, values, strict=True))
            return
        rng = np.random.default_rng(self.seed)
        for _ in range(self.samples):
            yield {v.name: float(rng.uniform(v.lower, v.upper)) for v in self.varied}

    def probes(self) -> Iterator[dict[str, float]]:
        """Yield the points that are checked before a campaign: corners, and every single value."""
        ends = [sorted({parameter.lower, parameter.upper}) for parameter in self.varied]
        for values in product(*ends):
            yield dict(zip(self.names, values, strict=True))
        lowest = {parameter.name: parameter.lower for parameter in self.varied}
        for parameter in self.varied:
            for value in parameter.values()[1:-1]:
                yield lowest | {parameter.name: value}

    def to_metadata(self) -> dict[str, str]:
        """Return the design as metadata of the table file."""
        ranges = {f"vary.{v.name}": f"{v.lower:g}:{v.upper:g}:{v.count}" for v in self.varied}
        return ranges | {
            "samples": str(self.samples), "seeds": str(self.seeds), "seed": str(self.seed),
        }  # fmt: skip

    def describe(self) -> str:
        """Return the number of points as text."""
        if self.samples:
            points = f"{self.samples} random points of {' and '.join(self.names)}"
        else:
            points = " x ".join(f"{parameter.count} {parameter.name}" for parameter in self.varied)
        return points + (f", {self.seeds} seeds" if self.seeds > 1 else "")
