"""Lay a pitch recording on an even clock: messages of different times joined, gaps left open.

A filter of constant gain needs readings at even times. Flight logs hold a row for each message,
and clocks scatter; where rows are even already nothing is touched.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.plural import pluralize
from benchtool.core.recording import Recording
from benchtool.simulate.pitch import filter_ticks as t
from benchtool.simulate.pitch.filter_log import PARKED_FROM_M

Mask = NDArray[np.bool_]

EVEN = 0.1  # steps within this share of the usual one are even; scattered clocks are worse
BRIDGED = 1.6  # a reading is interpolated between two that lie at most this many steps apart
HELD_S = 0.05  # longest hold of an unknown drive: some lags of a motor; assumed
MAX_GAP_S = 0.25  # how long the angle may stay unknown before a filter must begin anew; assumed
SLOWEST_HZ = 20.0  # lowest rate of the angle: steps of a plant are too long below; assumed
READINGS = re.compile(r"theta_rad|gyro_rad_s|rpm\d+")  # measured at a moment; others hold


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ResampledRecording:
    """Hold rows at even times."""

    recording: Recording  # the rows; a channel is nan where it was not read
    mode: Array  # (n,) what a filter does at each, see `simulate.pitch.filter_ticks`
    rate_Hz: float  # rows per second
    remarks: tuple[str, ...]  # what was repaired

    def select(self, good: Mask) -> ResampledRecording:
        """Return some of the rows (n,); after what is left out a filter begins anew."""
        restart = self.mode == t.RESTART
        restart[1:] |= ~good[:-1]
        mode = np.where(restart, float(t.RESTART), float(t.CORRECT))[good]
        if len(mode):
            mode[0] = t.RESTART
        return ResampledRecording(
            recording=self.recording.select(good), mode=mode, rate_Hz=self.rate_Hz,
            remarks=self.remarks,
        )  # fmt: skip


def resample_evenly(recording: Recording, name: str) -> ResampledRecording:
    """Return a recording's rows at even times.

    Raises:
        InputError: times that never go forward, or angles too far apart.
    """
    remarks: list[str] = []
    time_s = recording.to_si("time_s")
    good = np.isfinite(time_s)
    if not good.all():
        remarks.append(f"{pluralize(int((~good).sum()), 'row')} without a time left out")
        recording, time_s = recording.select(good), time_s[good]
    if len(time_s) < 3:
        raise InputError(f"{name} has {pluralize(len(time_s), 'row')} with a time; record it again")
    steps = np.diff(time_s)
    seen = np.isfinite(recording.column("theta_rad"))
    between = np.diff(time_s[seen])
    usual = float(np.median(between[between > 0.0])) if (between > 0.0).any() else 0.0
    if usual <= 0.0:
        raise InputError(f"time_s of {name} never goes forward; map the right column to it")
    if usual * SLOWEST_HZ > 1.0:
        raise InputError(
            f"theta_rad of {name} comes {1.0 / usual:.3g} times a second and at least "
            f"{SLOWEST_HZ:g} are needed, 100 to tell effects apart; record faster, or state the "
            f"unit of time_s in the model's [columns]"
        )
    backward, gaps = steps <= 0.0, steps > max(HELD_S, BRIDGED * usual)
    if not seen.all():  # rows of other messages may share a time with these
        backward = steps < 0.0
    if backward.any():
        at, times = float(time_s[1:][backward][0]), int(backward.sum())
        often = "once" if times == 1 else f"{times} times"
        remarks.append(f"the clock jumps back {often}, first to {at:.3f} s; judged in parts")
    if gaps.any():
        at, wide = float(time_s[:-1][gaps][0]), float(steps[gaps].max())
        many = pluralize(int(gaps.sum()), "gap")
        remarks.append(
            f"{many} in time, the first at {at:.3f} s, the longest {wide:.3f} s; judged in parts"
        )
    edges = [0, *(1 + np.flatnonzero(backward | gaps)), len(time_s)]
    parts = [slice(first, last) for first, last in pairwise(edges)]
    within = steps[~(backward | gaps)]
    even = np.abs(within - usual) < EVEN * usual
    if even.all() and seen.mean() > 0.5:
        rate_Hz = float(len(within) / within.sum())
    else:
        rate_Hz = 1.0 / usual
        remarks.append(f"rows are not even in time: laid on a clock of {rate_Hz:.4g} Hz")
        recording, parts = _laid(recording, time_s, parts, usual)
    mode = np.full(len(recording), float(t.CORRECT))
    mode[[part.start for part in parts if part.start < len(mode)]] = t.RESTART
    return ResampledRecording(
        recording=recording, mode=mode, rate_Hz=rate_Hz, remarks=tuple(remarks)
    )


def blank_for(values: Array, rate_Hz: float, seconds: float) -> Mask:
    """Return rows (n,) for which a channel has been blank for longer than so many seconds."""
    known = np.isfinite(values)
    rows = np.arange(len(values))
    last = np.maximum.accumulate(np.where(known, rows, -len(values)))
    mask: Mask = rows - last > seconds * rate_Hz
    return mask


def _laid(
    recording: Recording, time_s: Array, parts: list[slice], step_s: float
) -> tuple[Recording, list[slice]]:
    """Return rows on an even clock within each part, and where the parts are now."""
    clocks, laid, places = [], [], [0]
    for part in parts:
        inside = np.flatnonzero(np.isfinite(recording.column("theta_rad")[part]))
        if len(inside) < 2:
            continue
        times = time_s[part]
        first, last = times[inside[0]], times[inside[-1]]
        clock = first + step_s * np.arange(int((last - first) / step_s + 1e-6) + 1)
        read = [
            (_read if READINGS.fullmatch(name) else _held)(
                clock, times, recording.column(name)[part], step_s
            )
            for name in recording.names
        ]
        clocks.append(clock)
        laid.append(np.array(read))
        places.append(places[-1] + len(clock))
    values = np.concatenate(laid, axis=1) if laid else np.empty((len(recording.names), 0))
    columns = [
        (channel, np.concatenate(clocks) if channel.name == "time_s" and clocks else row)
        for channel, row in zip(recording.channels, values, strict=True)
    ]
    whole = Recording.from_columns(columns, recording.provenance, recording.simulated)
    return whole, [slice(first, last) for first, last in pairwise(places)]


def _read(clock: Array, times: Array, values: Array, step_s: float) -> Array:
    """Return readings at ticks between near ones, the nearest where they are sparse, or nan."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(clock), np.nan)
    at, seen = times[known], values[known]
    after = np.searchsorted(at, clock - 1e-9)
    left, right = np.maximum(after - 1, 0), np.minimum(after, len(at) - 1)
    apart = at[right] - at[left]
    between = np.interp(clock, at, seen)
    closer = np.where(np.abs(at[left] - clock) <= np.abs(at[right] - clock), left, right)
    near = np.abs(at[closer] - clock) <= 0.5 * step_s * (1.0 - 1e-6)
    out: Array = np.where(near, seen[closer], np.nan)
    exact = np.abs(at[right] - clock) < 1e-9
    inside = (apart <= BRIDGED * step_s) & (after > 0) & (after < len(at)) & ~exact
    return np.where(inside, between, out)


def _held(clock: Array, times: Array, values: Array, step_s: float) -> Array:
    """Return what was in force from each tick to the next, nan once it is older than may be held.

    On average: an output that is logged just after an angle acts nearly the whole tick.
    """
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(clock), np.nan)
    at, seen = times[known], values[known]
    edges = np.append(clock, clock[-1] + step_s)
    sums = np.concatenate([[0.0], np.cumsum(seen[:-1] * np.diff(at))])
    last = np.clip(np.searchsorted(at, edges, side="right") - 1, 0, len(at) - 1)
    total = sums[last] + seen[last] * (edges - at[last])
    middle = clock + 0.5 * step_s
    newest = np.searchsorted(at, middle, side="right") - 1
    age = middle - at[np.maximum(newest, 0)]
    fresh = (newest >= 0) & (age <= max(HELD_S, step_s) + 0.5 * step_s)
    return np.where(fresh, np.diff(total) / step_s, np.nan)


READ_S = 0.1  # two readings at 20 Hz; assumed

TRANSIT_S = 0.5 + READ_S
"""How long before and after its distance jumps a plate may cover a part of a disc, where nobody
says how fast it is: plates of shipped schedules take half a second. Before as well, because a plate
on its way out is still read. A choice."""

BLINK_S = 0.2  # a distance that returns within half of this is a missed echo; assumed


def is_plate_moving(plate_m: Array, rate_Hz: float, reach_s: float = TRANSIT_S) -> tuple[Mask, int]:
    """Return the rows (n,) in which a plate slides in or out, and how often it does.

    A plate that moves at all may also be on its way, in or out, where a recording begins or ends
    with it over a disc.

    Args:
        plate_m: (n,) distance, held between readings: m.
        rate_Hz: rows per second.
        reach_s: how long before and after a jump the plate may be on its way.
    """
    width = 2 * round(0.5 * BLINK_S * rate_Hz) + 1
    under = median_filter((plate_m < PARKED_FROM_M).astype(np.uint8), size=width, mode="nearest")
    jumps = np.flatnonzero(np.diff(under.astype(np.int8))) + 1
    reach = round(reach_s * rate_Hz)
    mask = np.zeros(len(plate_m), bool)
    for row in jumps:
        mask[max(row - reach, 0) : row + reach] = True
    if len(jumps):
        mask[:reach] |= bool(under[0])
        mask[len(mask) - reach :] |= bool(under[-1])
    return mask, len(jumps)
