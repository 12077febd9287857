"""Robust mean, standard error and settling test of a block of samples."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot, inf, log, nan, pi, sqrt

import numpy as np
from numpy import fft  # NumPy would load it in the first average, while motors turn

from benchtool.bench.bench import Bench
from benchtool.core.channel import channel_family
from benchtool.core.rig import Sensor, rounding_error
from benchtool.core.text import pluralize
from benchtool.core.units import Array


def read_span(bench: Bench, seconds: float, step_s: float = 0.1) -> Array:
    """Return the samples of a duration (n, c), in reads of at most `step_s`."""
    parts = [np.empty((0, len(bench.identity.channels)))]
    end_s = bench.now_s() + seconds
    while (remaining_s := end_s - bench.now_s()) > 1e-9:
        parts.append(bench.read(min(step_s, remaining_s)).values)
    return np.concatenate(parts)


OUTLIER_CUTOFF_SD = 5.0  # from the median; exceeded by 1 normal sample in 1.7 million; assumed
MIN_SAMPLES_FOR_REJECTION = 8  # no rejection with fewer samples; assumed
MAX_REJECTED_SHARE = 0.05  # with more, none is rejected and the point is suspect; assumed
COARSE_QUANTUM_SD = 0.05  # maximum resolution over reading; assumed


@dataclass(frozen=True, slots=True)
class Average:
    """Robust mean, standard deviation of the samples, standard error, number of samples.

    Attributes:
        apart: samples outside `range`.
        range: minimum and maximum accepted value.
        suspect: too many samples outside to be outliers; the mean is over all samples.
    """

    mean: float
    sd: float
    se: float
    n: int
    apart: tuple[float, ...] = ()
    range: tuple[float, float] = (-inf, inf)
    suspect: bool = False

    @property
    def n_rejected(self) -> int:
        """Number of samples that are not in the mean."""
        return 0 if self.suspect else len(self.apart)

    def rejection(self, channel: str) -> str:
        """Return a sentence about the outliers of a channel; "" without any."""
        if not self.apart:
            return ""
        total = self.n + self.n_rejected
        text = (
            f"{len(self.apart)} of {pluralize(total, 'sample')} of {channel} (from "
            f"{min(self.apart):.6g} to {max(self.apart):.6g}) lie outside "
            f"{self.range[0]:.6g} to {self.range[1]:.6g}, {OUTLIER_CUTOFF_SD:g} robust standard "
            f"deviations about the median,"
        )
        if not self.suspect:
            return f"{text} and are excluded from the mean"
        return (
            f"{text} more than {100.0 * MAX_REJECTED_SHARE:g} %: none is excluded and the point is "
            f"marked as suspect; check for hunting between two values or missed sensor readings"
        )


def average(values: Array, quantum: float = 0.0) -> Average:
    """Return the average of samples (n,), without outliers and nan.

    Mean after a Hampel identifier (skipped mean: Hampel, Technometrics 27 (1985) 95;
    a cutoff that depends on n: Davies and Gather, J. Am. Stat. Assoc. 88 (1993) 782). Against the
    plain mean of normal samples its efficiency is above 0.995 from 8 samples on, its breakdown
    point is `MAX_REJECTED_SHARE`.

    Args:
        quantum: resolution of the sensor; the remaining rounding error is added
            (`rounding_error`).
    """
    present = values[~np.isnan(values)]
    low, high = plausible_range(present, quantum)
    is_inside = (present >= low) & (present <= high)
    apart = tuple(present[~is_inside].tolist())
    suspect = len(apart) > max(1.0, MAX_REJECTED_SHARE * len(present))
    used = present if suspect else present[is_inside]
    n = len(used)
    if n == 0:
        return Average(nan, nan, nan, 0)
    mean = float(used.mean())
    if n == 1:
        return Average(mean, nan, nan, 1)
    sd = float(used.std(ddof=1))
    noise = sqrt(max(sd * sd - quantum * quantum / 12.0, 0.0))
    noise_only, line_error = remove_spectral_lines(used)
    scatter = float(noise_only.std(ddof=1)) * sqrt(statistical_inefficiency(noise_only) / n)
    se = hypot(scatter, line_error, rounding_error(noise, quantum))
    return Average(mean, sd, se, n, apart, (low, high), suspect)


def plausible_range(present: Array, quantum: float) -> tuple[float, float]:
    """Return the accepted range of values (n,).

    Median plus and minus `OUTLIER_CUTOFF_SD` (1 + 8/n) times 1.4826 median absolute deviations; the
    term in n keeps the efficiency for few samples. If more than half of the values are equal, the
    smallest step between values replaces the deviation.
    """
    n = len(present)
    if n < MIN_SAMPLES_FOR_REJECTION:
        return -inf, inf
    median = float(np.median(present))
    scale = 1.4826 * float(np.median(np.abs(present - median)))
    if scale == 0.0:
        steps = np.diff(np.unique(present))
        scale = min(float(steps.min()), COARSE_QUANTUM_SD * abs(median)) if len(steps) else 0.0
    half_width = OUTLIER_CUTOFF_SD * (1.0 + 8.0 / n) * max(scale, quantum)
    return median - half_width, median + half_width


def estimate_quantum(channel: str, sensors: Mapping[str, Sensor]) -> float:
    """Return the resolution of a channel in the rig; 0 if it states none."""
    sensor = sensors.get(channel_family(channel))
    return sensor.quantum if sensor else 0.0


def statistical_inefficiency(values: Array) -> float:
    """Return the factor of autocorrelation on the variance of the mean of values (n,).

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
    spectrum = fft.rfft(centred, size)
    correlation = fft.irfft(spectrum * spectrum.conj(), size)[:n] / variance
    pairs = correlation[0 : n - n % 2 : 2] + correlation[1::2]
    ends = np.flatnonzero(pairs <= 0.0)
    positive = pairs[: ends[0]] if len(ends) else pairs
    return float(np.clip(2.0 * positive.sum() - 1.0, 1.0, n))


MIN_LINE_POWER = 11.0  # over the noise; exceeded by 1 in 60,000 for normal noise; assumed
NOISE_BINS = 10  # bins to either side for the median noise power; assumed
LINE_LEAKAGE_BINS = 2  # bins to either side with leakage of a line; assumed
MIN_LINE_CYCLES = 4  # fewer cycles in the samples may be drift; assumed


def remove_spectral_lines(values: Array) -> tuple[Array, float]:
    """Return values (n,) with vibration lines reduced to the noise, and their error of the mean.

    The vibration of a rotor (possibly aliased) increases the scatter of samples but hardly changes
    their mean: c cycles of amplitude A give an error A / (2 pi c), rms over all phases.
    Fewer than four times `NOISE_BINS` values are not changed.
    """
    n = len(values)
    if n < 4 * NOISE_BINS:
        return values, 0.0
    spectrum = fft.rfft(values - values.mean())
    power = np.abs(spectrum) ** 2
    padded = np.pad(power[1:], NOISE_BINS, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * NOISE_BINS + 1)
    level = np.concatenate([[0.0], np.median(windows, axis=1) / log(2.0)])
    is_line = power > MIN_LINE_POWER * level
    is_line[:MIN_LINE_CYCLES] = False
    has_line = np.convolve(is_line, np.ones(2 * LINE_LEAKAGE_BINS + 1), mode="same") > 0.0
    has_line[:MIN_LINE_CYCLES] = False
    has_line &= power > level
    cycles = np.maximum(np.arange(len(power)), 1)
    share = np.where(has_line, (power - level) / (pi * n * cycles) ** 2, 0.0)
    spectrum[has_line] *= np.sqrt(level[has_line] / power[has_line])
    return fft.irfft(spectrum, n), sqrt(float(share.sum()))


MIN_SLOPE_SAMPLES = 8  # fewer samples do not determine a slope; assumed


@dataclass(frozen=True, slots=True)
class Slope:
    """Slope of a regression line, its standard error, and the mean."""

    per_s: float
    se_per_s: float
    mean: float

    def is_settled(self, tolerance_per_s: float) -> bool:
        """Return True if the slope is within tolerance (fraction of the mean per second).

        A slope below twice its standard error counts as settled, since it is not significant.
        """
        allowed = max(tolerance_per_s * abs(self.mean), 2.0 * self.se_per_s)
        return abs(self.per_s) <= allowed


def fit_slope(time_s: Array, values: Array) -> Slope:
    """Return the least-squares slope of values (n,) over time (n,), without nan.

    The standard error includes the autocorrelation of the residuals.
    """
    present = ~np.isnan(values)
    time, level = time_s[present], values[present]
    n = len(level)
    if n < MIN_SLOPE_SAMPLES:
        return Slope(inf, 0.0, 0.0)
    centred = time - time.mean()
    squares = float(centred @ centred)
    if squares <= 0.0:
        return Slope(inf, 0.0, 0.0)
    mean = float(level.mean())
    slope = float(centred @ level) / squares
    residual = level - mean - slope * centred
    variance = float(residual @ residual) / (n - 2)
    inflation = statistical_inefficiency(residual)
    return Slope(slope, sqrt(variance * inflation / squares), mean)


def is_settled(
    time_s: Array, channels: list[Array], window_s: float, tolerance_per_s: float
) -> bool:
    """Return True if every channel (n,) has settled over the last window."""
    if len(time_s) == 0 or time_s[-1] - time_s[0] < 0.98 * window_s:
        return False
    last = time_s >= time_s[-1] - window_s
    present = [channel[last] for channel in channels if not np.isnan(channel).all()]
    return bool(present) and all(
        fit_slope(time_s[last], channel).is_settled(tolerance_per_s) for channel in present
    )
