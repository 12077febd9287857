"""Shares of counts, with the interval that Wilson (1927) gives them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import nan, sqrt

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
