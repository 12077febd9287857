"""Resampling of pitch recordings to an even clock; gaps stay blank.

A filter of constant gain needs even times. Flight logs have one row per message, with jitter;
rows that are even already are unchanged.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from benchtool.core.errors import InputError
from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.simulate.pitch import lane as t
from benchtool.simulate.pitch.filter_log import MIN_PARKED_Z_M

Mask = NDArray[np.bool_]

MAX_JITTER = 0.1  # of even steps, relative to the median step
MAX_INTERPOLATION_STEPS = 1.6  # between readings to interpolate
HELD_S = 0.05  # maximum hold of a drive: a few motor lags; assumed
MAX_DROPOUT_S = 1.0  # longer dropouts stay blank in a track, as in import
MAX_GAP_S = 0.25  # of the angle, before the filter restarts; assumed
MIN_RATE_HZ = 20.0  # of the angle, for plant steps; assumed
READINGS = re.compile(r"theta_rad|gyro_rad_s|rpm\d+")  # instantaneous; other channels hold


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ResampledRecording:
    """Recording resampled at equal time steps."""

    recording: Recording  # nan where a channel has no reading
    mode: Array  # (n,) filter mode of each row, see `simulate.pitch.lane`
    rate_Hz: float  # rows per second
    remarks: tuple[str, ...]  # repairs

    def select(self, good: Mask) -> ResampledRecording:
        """Return selected rows (n,); the filter restarts after dropped rows."""
        restart = self.mode == t.RESTART
        restart[1:] |= ~good[:-1]
        mode = np.where(restart, float(t.RESTART), float(t.CORRECT))[good]
        if len(mode):
            mode[0] = t.RESTART
        return replace(self, recording=self.recording.select(good), mode=mode)


def resample_evenly(recording: Recording, name: str) -> ResampledRecording:
    """Return a recording resampled at equal time steps.

    Raises:
        InputError: times do not increase, or the rate of the angle is too low.
    """
    remarks: list[str] = []
    time_s = recording.to_si("time_s")
    has_time = np.isfinite(time_s)
    if not has_time.all():
        remarks.append(f"{pluralize(int((~has_time).sum()), 'row')} without a time dropped")
        recording, time_s = recording.select(has_time), time_s[has_time]
    if len(time_s) < 3:
        raise InputError(f"{name} has {pluralize(len(time_s), 'row')} with a time; minimum: 3 rows")
    steps = np.diff(time_s)
    has_angle = np.isfinite(recording.column("theta_rad"))
    gaps_s = np.diff(time_s[has_angle])
    median_step = float(np.median(gaps_s[gaps_s > 0.0])) if (gaps_s > 0.0).any() else 0.0
    if median_step <= 0.0:
        raise InputError(f"time_s of {name} does not increase; map the right column to it")
    if median_step * MIN_RATE_HZ > 1.0:
        raise InputError(
            f"sampling rate of theta_rad in {name} is {1.0 / median_step:.3g} Hz; minimum: "
            f"{MIN_RATE_HZ:g} Hz, recommended: 100 Hz; record faster or set the unit of time_s in "
            f"the model's [columns]"
        )
    backward, gaps = steps <= 0.0, steps > max(HELD_S, MAX_INTERPOLATION_STEPS * median_step)
    if not has_angle.all():  # rows of other messages may share a time with these
        backward = steps < 0.0
    if backward.any():
        first_s, n_jumps = float(time_s[1:][backward][0]), int(backward.sum())
        count = "once" if n_jumps == 1 else f"{n_jumps} times"
        remarks.append(f"the clock jumps back {count}, first to {first_s:.3f} s; judged in parts")
    if gaps.any():
        first_s, longest_s = float(time_s[:-1][gaps][0]), float(steps[gaps].max())
        remarks.append(
            f"{pluralize(int(gaps.sum()), 'gap')} in time, the first at {first_s:.3f} s, the "
            f"longest {longest_s:.3f} s; judged in parts"
        )
    edges = [0, *(1 + np.flatnonzero(backward | gaps)), len(time_s)]
    parts = [slice(first, last) for first, last in pairwise(edges)]
    part_steps = steps[~(backward | gaps)]
    is_even = np.abs(part_steps - median_step) < MAX_JITTER * median_step
    if is_even.all() and has_angle.mean() > 0.5:
        rate_Hz = float(len(part_steps) / part_steps.sum())
    else:
        rate_Hz = 1.0 / median_step
        remarks.append(f"rows are not even in time: resampled at {rate_Hz:.4g} Hz")
        recording, parts = _resample_parts(recording, time_s, parts, median_step)
    mode = np.full(len(recording), float(t.CORRECT))
    mode[[part.start for part in parts if part.start < len(mode)]] = t.RESTART
    return ResampledRecording(
        recording=recording, mode=mode, rate_Hz=rate_Hz, remarks=tuple(remarks)
    )


def find_segments(mode: Array) -> list[slice]:
    """Return the segments of a log, from each restart of the filter to the next."""
    edges = sorted({0, *np.flatnonzero(mode == t.RESTART), len(mode)})
    return [slice(first, last) for first, last in pairwise(edges)]


def blank_for(values: Array, rate_Hz: float, seconds: float) -> Mask:
    """Return rows (n,) after more than `seconds` without a value of a channel."""
    is_finite = np.isfinite(values)
    rows = np.arange(len(values))
    latest = np.maximum.accumulate(np.where(is_finite, rows, -len(values)))
    mask: Mask = rows - latest > seconds * rate_Hz
    return mask


def _resample_parts(
    recording: Recording, time_s: Array, parts: list[slice], step_s: float
) -> tuple[Recording, list[slice]]:
    """Return rows resampled within each part, and the new parts."""
    clocks, tables, edges = [], [], [0]
    for part in parts:
        angle_rows = np.flatnonzero(np.isfinite(recording.column("theta_rad")[part]))
        if len(angle_rows) < 2:
            continue
        times = time_s[part]
        start, end = times[angle_rows[0]], times[angle_rows[-1]]
        clock = start + step_s * np.arange(int((end - start) / step_s + 1e-6) + 1)
        resampler = Resampler(times, clock)
        rows = [
            (resampler.read if READINGS.fullmatch(name) else resampler.average)(
                recording.column(name)[part], step_s
            )
            for name in recording.names
        ]
        clocks.append(clock)
        tables.append(np.array(rows))
        edges.append(edges[-1] + len(clock))
    values = np.concatenate(tables, axis=1) if tables else np.empty((len(recording.names), 0))
    columns = [
        (channel, np.concatenate(clocks) if channel.name == "time_s" and clocks else row)
        for channel, row in zip(recording.channels, values, strict=True)
    ]
    resampled = Recording.from_columns(columns, recording.provenance, recording.simulated)
    return resampled, [slice(start, end) for start, end in pairwise(edges)]


@dataclass(frozen=True, slots=True, eq=False)
class Resampler:
    """Resampling of channels (m,) to a clock; blank where a channel has no reading."""

    time_s: Array  # (m,) of the readings
    clock: Array  # (n,) in order

    def find_readings(self, values: Array) -> tuple[Array, Array]:
        """Return times and values of the finite readings, in the order of time; nan without any."""
        rows = np.flatnonzero(np.isfinite(values) & np.isfinite(self.time_s))
        if not rows.size:
            return np.array([np.nan]), np.array([np.nan])
        rows = rows[np.argsort(self.time_s[rows], kind="stable")]
        return self.time_s[rows], values[rows]

    def interpolate(self, values: Array) -> Array:
        """Return readings, interpolated linearly except in dropouts (n,)."""
        times_s, readings = self.find_readings(values)
        resampled = np.interp(self.clock, times_s, readings, left=np.nan, right=np.nan)
        return self._without_dropouts(times_s, resampled)

    def hold(self, values: Array) -> Array:
        """Return values held until the next one except in dropouts (n,)."""
        times_s, outputs = self.find_readings(values)
        previous = np.searchsorted(times_s, self.clock + 1e-9, side="right") - 1
        resampled = np.where(previous >= 0, outputs[np.maximum(previous, 0)], np.nan)
        return self._without_dropouts(times_s, resampled)

    def _without_dropouts(self, times_s: Array, resampled: Array) -> Array:
        for gap in np.flatnonzero(np.diff(times_s) > MAX_DROPOUT_S):
            resampled[(self.clock > times_s[gap]) & (self.clock < times_s[gap + 1])] = np.nan
        return resampled

    def read(self, values: Array, step_s: float) -> Array:
        """Return readings at ticks: interpolated if dense, else the nearest one, else nan."""
        times_s, readings = self.find_readings(values)
        clock = self.clock
        after = np.searchsorted(times_s, clock - 1e-9)
        left, right = np.maximum(after - 1, 0), np.minimum(after, len(times_s) - 1)
        before_s, after_s = np.abs(times_s[left] - clock), np.abs(times_s[right] - clock)
        closer = np.where(before_s <= after_s, left, right)
        is_near = np.abs(times_s[closer] - clock) <= 0.5 * step_s * (1.0 - 1e-6)
        nearest: Array = np.where(is_near, readings[closer], np.nan)
        inside = (after > 0) & (after < len(times_s)) & (after_s >= 1e-9)
        inside &= times_s[right] - times_s[left] <= MAX_INTERPOLATION_STEPS * step_s
        return np.where(inside, np.interp(clock, times_s, readings), nearest)

    def average(self, values: Array, step_s: float) -> Array:
        """Return the mean of a held channel from each tick to the next; nan if it is too old.

        The mean, because an output logged just after an angle acts during nearly the whole tick.
        """
        times_s, outputs = self.find_readings(values)
        edges = np.append(self.clock, self.clock[-1] + step_s)
        sums = np.concatenate([[0.0], np.cumsum(outputs[:-1] * np.diff(times_s))])
        latest = np.clip(np.searchsorted(times_s, edges, side="right") - 1, 0, len(times_s) - 1)
        total = sums[latest] + outputs[latest] * (edges - times_s[latest])
        middle = self.clock + 0.5 * step_s
        newest = np.searchsorted(times_s, middle, side="right") - 1
        age = middle - times_s[np.maximum(newest, 0)]
        is_fresh = (newest >= 0) & (age <= max(HELD_S, step_s) + 0.5 * step_s)
        return np.where(is_fresh, np.diff(total) / step_s, np.nan)


READ_S = 0.1  # two readings at 20 Hz; assumed

# Default time of partial coverage before and after a jump of the distance: plates of the library's
# schedules slide for 0.5 s, and a plate that slides out is still read; assumed.
TRANSIT_S = 0.5 + READ_S

BLINK_S = 0.2  # a distance that returns within half of this is a missed echo; assumed


def is_plate_moving(plate_m: Array, rate_Hz: float, reach_s: float = TRANSIT_S) -> tuple[Mask, int]:
    """Return the rows (n,) in which a plate slides in or out, and the number of slides.

    If it moves at all, a slide is assumed at the start and end of a recording with a plate over a
    disc, too.

    Args:
        plate_m: (n,) distance, held between readings.
        reach_s: time before and after a jump in which the plate may slide.
    """
    width = 2 * round(0.5 * BLINK_S * rate_Hz) + 1
    present = median_filter((plate_m < MIN_PARKED_Z_M).astype(np.uint8), size=width, mode="nearest")
    jumps = np.flatnonzero(np.diff(present.astype(np.int8))) + 1
    reach = round(reach_s * rate_Hz)
    mask = np.zeros(len(plate_m), bool)
    for row in jumps:
        mask[max(row - reach, 0) : row + reach] = True
    if len(jumps):
        mask[:reach] |= bool(present[0])
        mask[len(mask) - reach :] |= bool(present[-1])
    return mask, len(jumps)
