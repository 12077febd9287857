"""The walk of a load cell's zero as the still stretches of a run show it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import minimize_scalar

from benchtool.core.array_type import Array
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig, Sensor
from benchtool.data.columns import speed_columns, word_to_code
from benchtool.data.run.read import is_run, read_samples, sample_names
from benchtool.data.run.zero_noise import ZeroNoise, zero_covariance

PRIOR_LN = 0.7  # standard deviation of the logarithm of a stated walk, a factor of two; assumed
LEAST_BINS = 8  # fewer means of a still bench say nothing of its walk; assumed
MOST_BINS = 240  # means that a run is cut into, about; their covariance has as many rows

BIN_S, SETTLED_S = 0.5, 0.4  # shortest span of a mean; left out after rotors stop; assumed


def add_zero_drift(points: Recording, path: str, rig: Rig) -> Recording:
    """Return a run's points with the walk of the zero that its still stretches show.

    Rotors stand still while the plate moves, and what the cell shows then is its zero. What the rig
    states is the prior. Points of anything but a run with samples are returned as they are.
    """
    sampled = is_run(path) and any(Path(path).glob("samples.*"))
    if not sampled or "thrust_N" not in sample_names(path):
        return points
    wanted = [name for name in sample_names(path) if name.startswith("rpm")]
    samples = read_samples(path, ["time_s", "phase", "thrust_N", *wanted])
    still = standstill_means(samples)
    if len(still) < LEAST_BINS:
        return points
    cell = rig.sensors.get("thrust_N", Sensor())
    found = estimate_zero_drift(still, ZeroNoise(cell.walk, cell.flicker))
    shown = {"zero_walk": repr(found.walk), "zero_walk_dof": repr(found.dof)}
    return replace(points, provenance={**points.provenance, **shown})


def standstill_means(samples: Recording) -> Array:
    """Return means of the load cell with nothing turning: tare, time, value, error (k, 4)."""
    time, thrust = samples.column("time_s"), samples.column("thrust_N")
    speeds = [samples.column(name) for name in speed_columns(samples.names, "rpm")]
    in_tare = samples.column("phase") == word_to_code("phase", "tare")
    quiet = np.isfinite(thrust) & ~in_tare  # within a tare the zero is being set
    for speed in speeds:
        quiet &= ~(np.abs(speed) > 0.0)
    if not speeds or not quiet.any():
        return np.empty((0, 4))
    begins = in_tare & ~np.concatenate([[False], in_tare[:-1]])
    tare = np.cumsum(begins)
    change = np.concatenate([[True], (quiet[1:] != quiet[:-1]) | begins[1:]])
    stretch = np.cumsum(change)
    began = time[change][stretch - 1]
    quiet &= time - began > SETTLED_S
    width = max(BIN_S, float(np.median(np.diff(time))) * quiet.sum() / MOST_BINS)
    number = stretch * 1_000_000 + ((time - began) / width).astype(int)
    rows = []
    for each in np.unique(number[quiet]):
        here = quiet & (number == each)
        if here.sum() >= LEAST_BINS:
            values = thrust[here]
            error = float(values.std(ddof=1)) / np.sqrt(len(values))
            rows.append((float(tare[here][0]), time[here].mean(), values.mean(), error))
    found = np.array(rows).reshape(-1, 4)
    if len(found):  # one error for all: that of one mean is of few samples
        found[:, 3] = max(float(np.median(found[:, 3])), 1e-12)
    return found


def estimate_zero_drift(still: Array, stated: ZeroNoise) -> ZeroNoise:
    """Return the walk that means of a still bench (k, 4) show, with the stated one as prior.

    The likeliest value of their exact covariance; level and drift since each tare are left free.
    """
    groups = []
    for number in np.unique(still[:, 0]):
        rows = still[still[:, 0] == number]
        since = rows[:, 1] - rows[0, 1]
        scale = 1e3 * np.max(rows[:, 3])
        free = scale**2 * (1.0 + np.outer(since, since) / max(float(since[-1]), 1.0) ** 2)
        alone = np.diag(rows[:, 3] ** 2) + free
        alone += zero_covariance(since, replace(stated, walk=0.0))
        # In these axes the rest has variance 1, and a walk of 1 adds `part`.
        part, axes = eigh(np.minimum(since[:, None], since), alone)
        groups.append((rows[:, 2] @ axes, np.maximum(part, 0.0)))

    def loss(log_walk: float) -> float:
        total = 0.0
        for rows, part in groups:
            variance = 1.0 + np.exp(2.0 * log_walk) * part
            total += 0.5 * float(np.sum(rows**2 / variance + np.log(variance)))
        if stated.walk > 0.0:
            total += 0.5 * ((log_walk - np.log(stated.walk)) / PRIOR_LN) ** 2
        return total

    error = float(np.median(still[:, 3]))
    low, high = np.log(1e-4 * error), np.log(1e2 * error)
    best = float(minimize_scalar(loss, bounds=(low, high), method="bounded").x)
    step = 0.1
    bend = (loss(best + step) - 2.0 * loss(best) + loss(best - step)) / step**2
    if best < low + 0.5:  # nothing of it shows
        return replace(stated, walk=0.0) if stated.walk == 0.0 else stated
    return replace(stated, walk=float(np.exp(best)), dof=float(max(0.5 * bend, 1.0)))
