"""The gap on the check recordings: as given, before, after, and the floor of a true model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchtool.core.array import Array
from benchtool.explain.engine.hypotheses import Hypotheses, Hypothesis
from benchtool.explain.engine.subject import ChannelErrors, Subject
from benchtool.explain.engine.verdict import ChannelGap

UPPER = 0.95
"""Quantile of the floor's draws that counts as the upper end of noise."""

RESAMPLES = 1000
"""Draws of the block bootstrap."""


DOUBT_DRAWS = 64
"""Draws behind the quantile that decides whether a gap is noise."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HeldOut:
    """Hold errors on the check recordings.

    Attributes:
        errors: by channel; columns are the model as given, before, after.
        floor: (draws,) by channel, of the model with the named effects taken for true.
        doubt: the same for the model before and after, its numbers as uncertain as they are.
    """

    errors: dict[str, ChannelErrors]
    floor: dict[str, Array]
    doubt: tuple[dict[str, Array], dict[str, Array]]

    @classmethod
    def of(
        cls,
        subject: Subject,
        hypotheses: Hypotheses,
        null: Hypothesis,
        best: Hypothesis,
        rng: np.random.Generator,
        draws: int,
    ) -> HeldOut:
        """Predict with the numbers before (`null`) and after (`best`)."""
        sets = np.vstack([np.zeros(len(null.at)), null.at, best.at])
        first = second = dict(subject.floor(null.at, rng, DOUBT_DRAWS, hypotheses.spread(null)))
        if best is not null:
            second = dict(subject.floor(best.at, rng, DOUBT_DRAWS, hypotheses.spread(best)))
        return cls(
            errors=dict(subject.errors(sets)),
            floor=dict(subject.floor(best.at, rng, draws)),
            doubt=(first, second),
        )

    def ratio(self, place: int) -> float:
        """Return the largest error over the upper noise quantile, before (0) or after (1)."""
        return max(
            float(
                np.sqrt(np.mean(found.squares[:, 1 + place]))
                / np.quantile(self.doubt[place][name], UPPER)
            )
            for name, found in self.errors.items()
        )

    @property
    def closed(self) -> float:
        """Share of the gap that is closed, in the channel where it is least.

        Root mean square over the floor's median; channels within the noise do not count.
        """
        shares = [1.0]
        for name, found in self.errors.items():
            floor = float(np.median(self.floor[name]))
            before, after = np.sqrt(np.mean(found.squares[:, 1:3], axis=0))
            if after > np.quantile(self.floor[name], UPPER):
                shares.append(float((before - after) / max(before - floor, 1e-12)))
        return min(shares)

    def gaps(self, rng: np.random.Generator) -> tuple[ChannelGap, ...]:
        """Return the gap of each channel."""
        out = []
        for name, found in self.errors.items():
            roots = np.sqrt(np.mean(found.squares, axis=0))
            blocks = rng.integers(len(found.squares), size=(RESAMPLES, len(found.squares)))
            drawn = np.sqrt(np.mean(found.squares[blocks], axis=1))
            low, high = np.quantile(drawn, [0.025, 0.975], axis=0)
            floor = self.floor[name]
            out.append(
                ChannelGap(
                    channel=name,
                    unit=found.unit,
                    as_given=float(roots[0]),
                    before=float(roots[1]),
                    after=float(roots[2]),
                    floor=float(np.median(floor)),
                    floor_low=float(np.quantile(floor, 1.0 - UPPER)),
                    floor_high=float(np.quantile(floor, UPPER)),
                    before_low=float(low[1]),
                    before_high=float(high[1]),
                    after_low=float(low[2]),
                    after_high=float(high[2]),
                )
            )
        return tuple(out)
