"""Settling by slope: a regression line over a window, against a tolerance and its own error."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, sqrt

import numpy as np

from benchtool.acquire.average import statistical_inefficiency
from benchtool.core.array import Array

FEWEST_SAMPLES = 8
"""A line through fewer samples says nothing about settling; a choice."""


@dataclass(frozen=True, slots=True)
class Slope:
    """Hold the slope of a regression line, its standard error, and the mean."""

    per_s: float
    se_per_s: float
    mean: float

    def settled(self, tolerance_per_s: float) -> bool:
        """Tell whether the slope is within tolerance (a share of the mean per second).

        A slope that cannot be told from zero (below twice its standard error) is settled as well:
        a longer look with the same noise would be needed to see it.
        """
        allowed = max(tolerance_per_s * abs(self.mean), 2.0 * self.se_per_s)
        return abs(self.per_s) <= allowed


def slope_of(time_s: Array, values: Array) -> Slope:
    """Return the least-squares slope of values (n,) over time (n,); nan left out.

    The standard error grows with the autocorrelation of the residuals.
    """
    present = ~np.isnan(values)
    time, level = time_s[present], values[present]
    n = len(level)
    if n < FEWEST_SAMPLES:
        return Slope(inf, 0.0, 0.0)
    centred = time - time.mean()
    spread = float(centred @ centred)
    if spread <= 0.0:
        return Slope(inf, 0.0, 0.0)
    mean = float(level.mean())
    slope = float(centred @ level) / spread
    residual = level - mean - slope * centred
    variance = float(residual @ residual) / (n - 2)
    inflation = statistical_inefficiency(residual)
    return Slope(slope, sqrt(variance * inflation / spread), mean)


def is_settled(
    time_s: Array, channels: list[Array], window_s: float, tolerance_per_s: float
) -> bool:
    """Tell whether every channel (n,) has settled over the last window.

    Not before the samples span the window.
    """
    if len(time_s) == 0 or time_s[-1] - time_s[0] < 0.98 * window_s:
        return False
    last = time_s >= time_s[-1] - window_s
    present = [channel[last] for channel in channels if not np.isnan(channel).all()]
    return bool(present) and all(
        slope_of(time_s[last], channel).settled(tolerance_per_s) for channel in present
    )
