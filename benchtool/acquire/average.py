"""A span of samples: read it, its mean and standard error, and whether it has settled."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan, sqrt

import numpy as np

from benchtool.bench.bench import Bench
from benchtool.core.array import Array


def read_span(bench: Bench, seconds: float, step_s: float = 0.1) -> Array:
    """Return what a bench reads for so long (n, c), in reads of at most `step_s`."""
    parts = [np.empty((0, len(bench.identity.channels)))]
    end_s = bench.now_s() + seconds
    while (left_s := end_s - bench.now_s()) > 1e-9:
        parts.append(bench.read(min(step_s, left_s)).values)
    return np.concatenate(parts)


@dataclass(frozen=True, slots=True)
class Average:
    """Hold mean, standard deviation of the samples, standard error of the mean, and count."""

    mean: float
    sd: float
    se: float
    n: int


def average(values: Array, quantum: float = 0.0) -> Average:
    """Return the average of samples (n,), nan left out.

    Args:
        quantum: resolution of the sensor. Where the samples scatter less than that, their scatter
            says nothing and the error is that of rounding, quantum/sqrt(12).
    """
    present = values[~np.isnan(values)]
    n = len(present)
    if n == 0:
        return Average(nan, nan, nan, 0)
    mean = float(present.mean())
    if n == 1:
        return Average(mean, nan, nan, 1)
    sd = float(present.std(ddof=1))
    se = sd * sqrt(statistical_inefficiency(present) / n)
    if sd < quantum:
        se = max(se, quantum / sqrt(12.0))
    return Average(mean, sd, se, n)


def statistical_inefficiency(values: Array) -> float:
    """Return by how much autocorrelation multiplies the variance of the mean of values (n,).

    1 for independent samples. Twice the sum of the autocorrelations, added in adjacent pairs
    while the pairs stay positive (initial positive sequence: Geyer, Statistical Science 7 (1992)
    473, section 3.3), never below 1 and never above n.
    """
    n = len(values)
    centred = values - values.mean()
    variance = float(centred @ centred)
    if n < 4 or variance <= 0.0:
        return 1.0
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.fft.rfft(centred, size)
    correlation = np.fft.irfft(spectrum * spectrum.conj(), size)[:n] / variance
    pairs = correlation[0 : n - n % 2 : 2] + correlation[1::2]
    ends = np.flatnonzero(pairs <= 0.0)
    positive = pairs[: ends[0]] if len(ends) else pairs
    return float(np.clip(2.0 * positive.sum() - 1.0, 1.0, n))


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

        A slope below twice its standard error is settled as well: a longer look with the same
        noise would be needed to see it.
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
