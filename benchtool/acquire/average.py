"""The mean of a settled span, and its standard error with autocorrelation accounted for."""

from __future__ import annotations

from dataclasses import dataclass
from math import nan, sqrt

import numpy as np

from benchtool.core.array import Array


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
        values: samples at even spacing.
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
    kept = pairs[: ends[0]] if len(ends) else pairs
    return float(np.clip(2.0 * kept.sum() - 1.0, 1.0, n))
