"""Estimation of a load cell's zero drift (random walk) from the standstill phases of a run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.linalg import eigh
from scipy.optimize import minimize_scalar

from benchtool.core.recording import Recording
from benchtool.core.rig import Rig, Sensor
from benchtool.core.units import Array
from benchtool.data.calibration import ZeroNoise, zero_covariance
from benchtool.data.columns import speed_columns, word_to_code
from benchtool.data.run.read import is_run, read_samples, sample_names

PRIOR_LN = 0.7  # standard deviation of the logarithm of a stated walk, a factor of two; assumed
MIN_BINS = 8  # means at standstill, and samples of a mean; assumed
MAX_BINS = 240  # approximate number of means of a run, the rows of their covariance

BIN_S, SETTLED_S = 0.5, 0.4  # minimum duration of a mean; settling time after a stop; assumed


def add_zero_drift(points: Recording, path: str, rig: Rig) -> Recording:
    """Return a run's points with the random walk of the zero, estimated at standstill.

    Rotors stand still while the plate moves, so that the load cell reads its zero. The prior is the
    rig's value. Points are unchanged without samples.
    """
    has_samples = is_run(path) and any(Path(path).glob("samples.*"))
    if not has_samples or "thrust_N" not in sample_names(path):
        return points
    speed_names = [name for name in sample_names(path) if name.startswith("rpm")]
    samples = read_samples(path, ["time_s", "phase", "thrust_N", *speed_names])
    means = standstill_means(samples)
    if len(means) < MIN_BINS:
        return points
    cell = rig.sensors.get("thrust_N", Sensor())
    estimate = estimate_zero_drift(means, ZeroNoise(cell.walk, cell.flicker))
    provenance = {"zero_walk": repr(estimate.walk), "zero_walk_dof": repr(estimate.dof)}
    return replace(points, provenance={**points.provenance, **provenance})


def standstill_means(samples: Recording) -> Array:
    """Return load cell means at standstill: tare, time, value, error (k, 4)."""
    time, thrust = samples.column("time_s"), samples.column("thrust_N")
    speeds = [samples.column(name) for name in speed_columns(samples.names, "rpm")]
    in_tare = samples.column("phase") == word_to_code("phase", "tare")
    is_still = np.isfinite(thrust) & ~in_tare  # within a tare the zero is being set
    for speed in speeds:
        is_still &= ~(np.abs(speed) > 0.0)
    if not speeds or not is_still.any():
        return np.empty((0, 4))
    is_tare_start = in_tare & ~np.concatenate([[False], in_tare[:-1]])
    tare = np.cumsum(is_tare_start)
    is_phase_start = np.concatenate([[True], (is_still[1:] != is_still[:-1]) | is_tare_start[1:]])
    phase = np.cumsum(is_phase_start)
    start = time[is_phase_start][phase - 1]
    is_still &= time - start > SETTLED_S
    width = max(BIN_S, float(np.median(np.diff(time))) * is_still.sum() / MAX_BINS)
    bins = phase * 1_000_000 + ((time - start) / width).astype(int)
    rows = []
    for bin_number in np.unique(bins[is_still]):
        in_bin = is_still & (bins == bin_number)
        if in_bin.sum() >= MIN_BINS:
            values = thrust[in_bin]
            error = float(values.std(ddof=1)) / np.sqrt(len(values))
            rows.append((float(tare[in_bin][0]), time[in_bin].mean(), values.mean(), error))
    means = np.array(rows).reshape(-1, 4)
    if len(means):  # one error for all, because a mean has few samples
        means[:, 3] = max(float(np.median(means[:, 3])), 1e-12)
    return means


def estimate_zero_drift(means: Array, prior: ZeroNoise) -> ZeroNoise:
    """Return the random walk from means at standstill (k, 4), with the stated one as prior.

    Maximum of likelihood (exact covariance) times prior; level and drift since each tare are free.
    """
    groups = []
    for number in np.unique(means[:, 0]):
        rows = means[means[:, 0] == number]
        time_s = rows[:, 1] - rows[0, 1]
        scale = 1e3 * np.max(rows[:, 3])
        level_and_drift = 1.0 + np.outer(time_s, time_s) / max(float(time_s[-1]), 1.0) ** 2
        covariance = np.diag(rows[:, 3] ** 2) + scale**2 * level_and_drift
        covariance += zero_covariance(time_s, replace(prior, walk=0.0))
        # On these axes a walk w adds w^2 times the eigenvalue to a variance of 1.
        eigenvalues, eigenvectors = eigh(np.minimum(time_s[:, None], time_s), covariance)
        groups.append((rows[:, 2] @ eigenvectors, np.maximum(eigenvalues, 0.0)))

    def loss(log_walk: float) -> float:
        total = 0.0
        for rows, eigenvalues in groups:
            variance = 1.0 + np.exp(2.0 * log_walk) * eigenvalues
            total += 0.5 * float(np.sum(rows**2 / variance + np.log(variance)))
        if prior.walk > 0.0:
            total += 0.5 * ((log_walk - np.log(prior.walk)) / PRIOR_LN) ** 2
        return total

    error = float(np.median(means[:, 3]))
    low, high = np.log(1e-4 * error), np.log(1e2 * error)
    best = float(minimize_scalar(loss, bounds=(low, high), method="bounded").x)
    step = 0.1
    curvature = (loss(best + step) - 2.0 * loss(best) + loss(best - step)) / step**2
    if best < low + 0.5:  # the data show no walk
        return replace(prior, walk=0.0) if prior.walk == 0.0 else prior
    return replace(prior, walk=float(np.exp(best)), dof=float(max(0.5 * curvature, 1.0)))
