"""A span of samples: read it, its robust mean and standard error, and whether it has settled."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import hypot, inf, log, nan, pi, sqrt

import numpy as np

from benchtool.bench.bench import Bench
from benchtool.core.array_type import Array
from benchtool.core.channel import channel_family
from benchtool.core.plural import pluralize
from benchtool.core.rig import Sensor, rounding_error


def read_span(bench: Bench, seconds: float, step_s: float = 0.1) -> Array:
    """Return what a bench reads for so long (n, c), in reads of at most `step_s`."""
    parts = [np.empty((0, len(bench.identity.channels)))]
    end_s = bench.now_s() + seconds
    while (left_s := end_s - bench.now_s()) > 1e-9:
        parts.append(bench.read(min(step_s, left_s)).values)
    return np.concatenate(parts)


OUTLIER_CUTOFF_SD = 5.0  # from the median; 1 normal sample in 1.7 million is an outlier; assumed
MIN_SAMPLES_FOR_REJECTION = 8  # among fewer samples none is an outlier; assumed

# Share of outliers; with more, none is left out and the point is marked; assumed.
MAX_REJECTED_SHARE = 0.05
COARSE_QUANTUM_SD = (
    0.05  # largest step of a sensor's own resolution, as a share of its reading; assumed
)


@dataclass(frozen=True, slots=True)
class Average:
    """Hold a robust mean, standard deviation of its samples, its standard error, their count.

    Attributes:
        apart: samples that lie outside of `range`, nearest to the median or not.
        range: least and greatest value that belongs to the others.
        suspect: too many lie apart to be outliers; the mean is over all samples.
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
        """How many samples are not in the mean."""
        return 0 if self.suspect else len(self.apart)

    def rejection(self, channel: str) -> str:
        """Return in words which samples of a channel lie apart and what was done; "" for none."""
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
            return f"{text} and are left out of its mean"
        return (
            f"{text} more than {100.0 * MAX_REJECTED_SHARE:g} %: none is left out and the point is "
            f"marked as suspect; see whether it hunts between two values or its sensor misses some"
        )


def average(values: Array, quantum: float = 0.0) -> Average:
    """Return the average of samples (n,), outliers and nan left out.

    The mean of what a Hampel identifier leaves (skipped mean: Hampel, Technometrics 27 (1985) 95;
    a cutoff that depends on n: Davies and Gather, J. Am. Stat. Assoc. 88 (1993) 782). Against the
    plain mean of normal samples its efficiency is above 0.995 from 8 samples on, its breakdown
    point is `MAX_REJECTED_SHARE`.

    Args:
        quantum: resolution of the sensor; what the samples' scatter leaves of the error of rounding
            is added (`rounding_error`).
    """
    present = values[~np.isnan(values)]
    low, high = plausible_range(present, quantum)
    inside = (present >= low) & (present <= high)
    apart = tuple(present[~inside].tolist())
    suspect = len(apart) > max(1.0, MAX_REJECTED_SHARE * len(present))
    used = present if suspect else present[inside]
    n = len(used)
    if n == 0:
        return Average(nan, nan, nan, 0)
    mean = float(used.mean())
    if n == 1:
        return Average(mean, nan, nan, 1)
    sd = float(used.std(ddof=1))
    noise = sqrt(max(sd * sd - quantum * quantum / 12.0, 0.0))
    noise_only, of_lines = remove_spectral_lines(used)
    scatter = float(noise_only.std(ddof=1)) * sqrt(statistical_inefficiency(noise_only) / n)
    se = hypot(scatter, of_lines, rounding_error(noise, quantum))
    return Average(mean, sd, se, n, apart, (low, high), suspect)


def plausible_range(present: Array, quantum: float) -> tuple[float, float]:
    """Return the least and the greatest of values (n,) that are no outliers.

    The median and `OUTLIER_CUTOFF_SD` (1 + 8/n) times 1.4826 median absolute deviations to both
    sides; the term in n keeps the efficiency of few samples. Where more than half of them are
    equal, the smallest step between values stands for the deviation.
    """
    n = len(present)
    if n < MIN_SAMPLES_FOR_REJECTION:
        return -inf, inf
    median = float(np.median(present))
    scale = 1.4826 * float(np.median(np.abs(present - median)))
    if scale == 0.0:
        steps = np.diff(np.unique(present))
        scale = min(float(steps.min()), COARSE_QUANTUM_SD * abs(median)) if len(steps) else 0.0
    reach = OUTLIER_CUTOFF_SD * (1.0 + 8.0 / n) * max(scale, quantum)
    return median - reach, median + reach


def estimate_quantum(channel: str, sensors: Mapping[str, Sensor]) -> float:
    """Return the resolution that a rig states for a channel; 0 where it states none."""
    sensor = sensors.get(channel_family(channel))
    return sensor.quantum if sensor else 0.0


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


LINE = 11.0  # power over the noise of a vibration: 1 in 60,000 for normal noise; assumed
NEIGHBOURS = 10  # frequencies to either side whose median power is that of the noise; assumed
LINE_LEAKAGE_BINS = (
    2  # frequencies to either side that a line reaches with a part of its power; assumed
)
MAX_LINE_PERIOD = 4  # cycles in the samples below which a line is drift as well; assumed


def remove_spectral_lines(values: Array) -> tuple[Array, float]:
    """Return values (n,) with vibrations brought to the noise, and their part of the mean's error.

    A rotor's vibration (aliased, at a frequency of its own) makes samples scatter and hardly moves
    their mean: c cycles of amplitude A leave A / (2 pi c), root mean square over all phases. Fewer
    than four times `NEIGHBOURS` values are left as they are.
    """
    n = len(values)
    if n < 4 * NEIGHBOURS:
        return values, 0.0
    spectrum = np.fft.rfft(values - values.mean())
    power = np.abs(spectrum) ** 2
    around = np.pad(power[1:], NEIGHBOURS, mode="reflect")
    windows = np.lib.stride_tricks.sliding_window_view(around, 2 * NEIGHBOURS + 1)
    level = np.concatenate([[0.0], np.median(windows, axis=1) / log(2.0)])
    line = power > LINE * level
    line[:MAX_LINE_PERIOD] = False
    reached = np.convolve(line, np.ones(2 * LINE_LEAKAGE_BINS + 1), mode="same") > 0.0
    reached[:MAX_LINE_PERIOD] = False
    reached &= power > level
    cycles = np.maximum(np.arange(len(power)), 1)
    share = np.where(reached, (power - level) / (pi * n * cycles) ** 2, 0.0)
    spectrum[reached] *= np.sqrt(level[reached] / power[reached])
    return np.fft.irfft(spectrum, n), sqrt(float(share.sum()))


MIN_SLOPE_SAMPLES = 8  # a line through fewer samples says nothing about settling; assumed


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


def fit_slope(time_s: Array, values: Array) -> Slope:
    """Return the least-squares slope of values (n,) over time (n,); nan left out.

    The standard error grows with the autocorrelation of the residuals.
    """
    present = ~np.isnan(values)
    time, level = time_s[present], values[present]
    n = len(level)
    if n < MIN_SLOPE_SAMPLES:
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
        fit_slope(time_s[last], channel).settled(tolerance_per_s) for channel in present
    )
