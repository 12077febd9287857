"""Hypotheses about what a model lacks, from "nothing that matters" upward.

The null is composite: every effect may be there within its tolerance, and what the owner knows
only roughly may be anywhere its uncertainty allows. An effect is named only where its own
tolerance must break. A bench with ten small real imperfections is still a bench on which nothing
is missing; a test against exactly zero would name one of them on every record.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.estimate.bounded import BoundedSearch, Linearised, Minimum, Region
from benchtool.explain.evidence import Evidence

Array = NDArray[np.float64]

SMALL = 0.5
"""Standard deviation of an effect that is there within its tolerance, in tolerances: what is said
to be too small to matter is mostly well below it. A choice, not a fit."""

REACH = 2.0
"""How many standard errors a number that the owner knows roughly may be off."""

WORTH_A_FIT = 2.0
"""Gain in the sum of squares that the null's own neighbourhood must promise before a candidate
gets a fit of its own."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Hypothesis:
    """Hold a set of effects that may break their tolerances, and the best numbers under it.

    Attributes:
        opened: names of those effects, in the order in which they were added; none for the null.
        at: (n_knobs,) the best numbers, in scales.
        cost: sum of squares there, penalties included.
        converged: whether the search came to rest.
    """

    opened: tuple[str, ...]
    at: Array
    cost: float
    converged: bool


class Hypotheses:
    """Fit hypotheses to evidence.

    Args:
        evidence: what recordings say.
    """

    def __init__(self, evidence: Evidence) -> None:
        self.evidence = evidence
        knobs = evidence.knobs
        self._limits = (
            np.array([knob.least for knob in knobs]),
            np.array([knob.most for knob in knobs]),
        )
        self._search = BoundedSearch(evidence.residuals, self._limits)
        self.effects = tuple(dict.fromkeys(knob.effect for knob in knobs if knob.effect))
        self._near: dict[bytes, Linearised] = {}

    def region(self, opened: Iterable[str]) -> Region:
        """Return bounds and penalties under which only some effects may break their tolerance."""
        names = set(opened)
        knobs = self.evidence.knobs
        wide = np.array([knob.effect in names for knob in knobs])
        held = np.array([knob.held for knob in knobs])
        reach = np.where(wide, np.inf, np.where(held, REACH, 1.0))
        return Region(
            lower=np.maximum(self._limits[0], -reach),
            upper=np.minimum(self._limits[1], reach),
            penalty=np.where(wide, 0.0, np.where(held, 1.0, 1.0 / SMALL)),
        )

    def near(self, at: Array) -> Linearised:
        """Return the neighbourhood of a point; the same one is worked out once."""
        key = at.tobytes()
        if key not in self._near:
            self._near[key] = self._search.linearised(at)
        return self._near[key]

    def null(self, opened: tuple[str, ...] = ()) -> Hypothesis:
        """Return the best numbers with those effects open, from the model as given."""
        start = self.region(opened).clipped(np.zeros(len(self.evidence.knobs)))
        return self._fitted(opened, [start])

    def refitted(self, opened: tuple[str, ...], *starts: Hypothesis) -> Hypothesis:
        """Return the best numbers with those effects open, from where others ended."""
        return self._fitted(opened, [other.at for other in starts])

    def with_one_more(self, base: Hypothesis) -> list[Hypothesis]:
        """Return the base with each other effect opened in turn, best first."""
        near = self.near(base.at)
        out = []
        for name in self.effects:
            if name in base.opened:
                continue
            opened = (*base.opened, name)
            region = self.region(opened)
            _, promised = near.step(region)
            if base.cost - promised < WORTH_A_FIT:
                out.append(Hypothesis(opened=opened, at=base.at, cost=base.cost, converged=True))
                continue
            found = self._search.minimum(base.at, region, known=near)
            out.append(_of(opened, found))
        return sorted(out, key=lambda item: item.cost)

    def secured(self, base: Hypothesis, others: Iterable[Hypothesis]) -> Hypothesis:
        """Return the base refitted from others' optima, so that it is not above a feasible one.

        A candidate whose optimum lies inside its tolerance is itself a point of the base; one
        outside, moved back to the tolerance's edge, is a start that the base may not have seen.
        """
        region = self.region(base.opened)
        best = base
        for other in others:
            start = region.clipped(other.at)
            found = self._search.minimum(start, region, known=None)
            if found.cost < best.cost:
                best = _of(base.opened, found)
        return best

    def _fitted(self, opened: tuple[str, ...], starts: list[Array]) -> Hypothesis:
        region = self.region(opened)
        found = [
            self._search.minimum(start, region, known=self.near(region.clipped(start)))
            for start in starts
        ]
        return _of(opened, min(found, key=lambda item: item.cost))


def _of(opened: tuple[str, ...], found: Minimum) -> Hypothesis:
    return Hypothesis(opened=opened, at=found.at, cost=found.cost, converged=found.converged)
