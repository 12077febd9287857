"""Everything that a report of an explanation draws: the verdict with the curves behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from benchtool.core.array import Array
from benchtool.explain.engine.verdict import Verdict


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Overlay:
    """Hold measurement and predictions of one channel on a check recording.

    Attributes:
        channel: its name.
        unit: of the values.
        axis: what `at` counts ("time_s", "z_over_R").
        at: (n,) places on that axis; nan between windows, so that lines break there.
        measured: (n,).
        before: (n,) the model as calibrated within tolerance.
        after: (n,) with the named effects; equal to `before` where nothing is named.
    """

    channel: str
    unit: str
    axis: str
    at: Array
    measured: Array
    before: Array
    after: Array


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Disagreement:
    """Hold where residuals stand out, for the picture of "where".

    Attributes:
        stage: name of the link, or channel.
        by_regime: root mean square of the whitened residuals by regime in words; 1 is noise.
        after: the same with the named effects.
    """

    stage: str
    by_regime: Mapping[str, float]
    after: Mapping[str, float]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TrueMisses:
    """Hold what a true model misses on the check recordings, draw by draw of the stated noise.

    Attributes:
        known: (draws,) by channel, its numbers known exactly; the floor is their median.
        learned: (draws,) by channel, the truth as far from its numbers as the recordings to learn
            from leave them uncertain.
    """

    known: Mapping[str, Array] = field(default_factory=dict)
    learned: Mapping[str, Array] = field(default_factory=dict)

    def within(self, floors: float) -> tuple[float, float]:
        """Return the share of draws, known and learned, that no channel has above so many floors.

        What a count of gaps over many recordings comes to by luck alone, and by luck and what was
        not learned.
        """
        highest = [
            np.max([draws[name] / np.median(self.known[name]) for name in draws], axis=0)
            for draws in (self.known, self.learned)
        ]
        known, learned = (float(np.mean(one <= floors)) for one in highest)
        return known, learned


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Explanation:
    """Hold a verdict and the curves behind it.

    Attributes:
        verdict: the answer.
        overlays: by channel, on the check recordings.
        disagreements: by stage.
        true_misses: what the check recordings may leave of a true model.
    """

    verdict: Verdict
    overlays: tuple[Overlay, ...]
    disagreements: tuple[Disagreement, ...]
    true_misses: TrueMisses = field(default_factory=TrueMisses)
