"""Everything that a report of an explanation draws: the verdict with the curves behind it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.explain.verdict import Verdict

Array = NDArray[np.float64]


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
class Explanation:
    """Hold a verdict and the curves behind it.

    Attributes:
        verdict: the answer.
        overlays: by channel, on the check recordings.
        disagreements: by stage.
    """

    verdict: Verdict
    overlays: tuple[Overlay, ...]
    disagreements: tuple[Disagreement, ...]
