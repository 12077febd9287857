"""The gap on the check recordings: as given, before, after, and the floor of a true model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchtool.core.array import Array
from benchtool.explain.engine.hypotheses import Hypotheses, Hypothesis
from benchtool.explain.engine.learned import Learned
from benchtool.explain.engine.subject import ChannelErrors, Subject
from benchtool.explain.engine.verdict import ChannelGap

UPPER = 0.95  # quantile of the floor's draws that counts as the upper end of noise
CLOSED = 0.8  # share of the gap above the floor that a right explanation closes; assumed
RESAMPLES = 1000  # draws of the block bootstrap
DOUBT_DRAWS = 64  # draws of a floor with uncertain numbers


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class HeldOut:
    """Hold errors on the check recordings.

    Attributes:
        errors: by channel; columns are the model as given, before, after.
        floor: (draws,) by channel, of the model with the named effects taken for true.
        doubt: the same, the model's numbers as uncertain as they are.
    """

    errors: dict[str, ChannelErrors]
    floor: dict[str, Array]
    doubt: dict[str, Array]

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
        learned = Learned(hypotheses, subject.all_evidence)
        sets = np.vstack([np.zeros(len(null.at)), null.at, best.at])
        before = learned.mean(null)
        changes = np.stack([np.zeros_like(before), before, learned.mean(best)], axis=1)

        drawn = learned.drawn(best, rng, DOUBT_DRAWS)
        return cls(
            errors=dict(subject.errors(sets, changes)),
            doubt=dict(subject.floor(best.at, drawn, rng, hypotheses.spread(best))),
            floor=dict(subject.floor(best.at, learned.drawn(best, rng, draws), rng)),
        )

    @property
    def left(self) -> tuple[float, float]:
        """The largest error over the median of its floor: of all channels, of those hardly gained.

        A channel hardly gains where less than `CLOSED` of its gap above the floor is closed.
        """
        ratios, unclosed = [0.0], [0.0]
        for name, channel in self.errors.items():
            _, before, after = np.mean(channel.squares, axis=0)
            floor = float(np.median(self.floor[name])) ** 2
            ratios.append(float(np.sqrt(after / floor)))
            if before - after < CLOSED * (before - floor):
                unclosed.append(float(np.sqrt(min(before, after) / floor)))
        return max(ratios), max(unclosed)

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
