"""Load cell errors: the scale of each calibration, and zero drift estimated at standstill."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import minimize_scalar
from scipy.special import fdtrc

from benchtool.core.error_source import ErrorSource
from benchtool.core.parameter import Parameter, Parameters, Prior
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.units import Array
from benchtool.data.calibration import (
    ZeroNoise,
    degrees_of_freedom,
    format_age_warning,
    format_traceability,
    read_calibration,
    zero_covariance,
    zero_noise,
)
from benchtool.data.columns import speed_columns, word_to_code
from benchtool.data.run.read import is_run, read_samples, sample_names
from benchtool.data.run.run_metadata import read_metadata
from benchtool.fit.problem import IntArray, Problem

TARED_ZERO_N = 1e-6  # zero error of a calibration after a tare: none; above 0 for the prior


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ScaleError:
    """Scale error shared by the points of one calibration."""

    calibration: Mapping[str, Any]  # the calibration as in its file or a run's metadata
    rows: NDArray[np.bool_]  # (n,) True for its points

    @property
    def traceability(self) -> str:
        """Traceability statement of the calibration."""
        return format_traceability(self.calibration)


def find_scale_errors(
    paths: Sequence[str], parts: Sequence[Recording], table: str | None
) -> tuple[tuple[ScaleError, ...], list[str]]:
    """Return the calibrations of data paths, and warnings on old or missing ones.

    `table` is the calibration file for tables; None if unknown.
    """
    owners = np.repeat(np.arange(len(parts)), [len(part) for part in parts])
    by_id: dict[str, tuple[Mapping[str, Any], list[int]]] = {}
    warnings, without = [], []
    for index, path in enumerate(paths):
        folder = next(filter(is_run, (Path(path), Path(path).parent)), None)
        metadata = {} if folder is None else read_metadata(folder)
        calibration = metadata.get("calibration")
        if folder is None and table is not None:
            calibration = asdict(read_calibration(Path(table)))
        if not calibration:
            without.append(path)
            continue
        if age_warning := format_age_warning(metadata):
            warnings.append(f"{path}: {age_warning}")
        by_id.setdefault(str(calibration["id"]), (calibration, []))[1].append(index)
    if by_id and without:
        warnings.append(
            f"{', '.join(without)} has no calibration, so that its scale counts as exact; "
            f"recalibrate it, or set --calibration"
        )
    pooled = pool_calibrations([calibration for calibration, _ in by_id.values()])
    errors = tuple(
        ScaleError(calibration=calibration, rows=np.isin(owners, indices))
        for calibration, (_, indices) in zip(pooled, by_id.values(), strict=True)
    )
    return errors, warnings


MAX_CALIBRATION_DIFFERENCE = 0.001  # p-value below which a scatter is not pooled; assumed
POOLED = "scatter of the calibrations"  # name of the pooled estimate


def pool_calibrations(calibrations: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return calibrations with pooled scatter of readings.

    Scatter from few masses is uncertain, and weights from it favour calibrations that are straight
    by chance: for three cells with five masses each, 65 and 88 % of the intervals contained the
    truth instead of 68 and 95. A calibration with significantly larger scatter (F test, in newtons)
    is not pooled; none is if one lacks its scatter.
    """
    lines = [_line(calibration) for calibration in calibrations]
    if len(lines) < 2 or any(line is None for line in lines):
        return list(calibrations)
    dof, scatter = np.array([line for line in lines if line is not None]).T
    others = (dof @ scatter**2 - dof * scatter**2) / (dof.sum() - dof)
    if (scatter <= 0.0).any() or (others <= 0.0).any():
        return list(calibrations)
    is_alike = fdtrc(dof, dof.sum() - dof, scatter**2 / others) > MAX_CALIBRATION_DIFFERENCE
    if is_alike.sum() < 2:
        return list(calibrations)
    pooled_scatter = float(np.sqrt(dof[is_alike] @ scatter[is_alike] ** 2 / dof[is_alike].sum()))
    pooled: list[Mapping[str, Any]] = []
    for calibration, own_scatter, is_pooled in zip(calibrations, scatter, is_alike, strict=True):
        if not is_pooled:
            pooled.append(calibration)
            continue
        factor = pooled_scatter / own_scatter
        parts = [
            {**part, "sd": factor * part["sd"], "relative_sd": factor * part["relative_sd"],
             "dof": float(dof[is_alike].sum()), "scatter": POOLED}
            if part["name"] == "repeat" else part
            for part in calibration["components"]
        ]  # fmt: skip
        total = float(np.sqrt(sum(part["relative_sd"] ** 2 for part in parts)))
        pooled.append({**calibration, "components": parts, "relative_sd": total})
    return pooled


def _line(calibration: Mapping[str, Any]) -> tuple[float, float] | None:
    """Return degrees of freedom and scatter of a calibration's readings: N; None if not stated."""
    repeats = [part for part in calibration.get("components") or () if part["name"] == "repeat"]
    if not repeats or not repeats[0]["dof"] or not calibration.get("residual_sd_N"):
        return None
    return float(repeats[0]["dof"]), float(calibration["residual_sd_N"])


def with_scale_errors(
    problem: Problem, errors: Sequence[ScaleError], used: IntArray | slice = slice(None)
) -> Problem:
    """Return the problem of the used points with each calibration as two nuisance parameters.

    An observation is `calibration.scale` times the prediction plus `calibration.offset_N`. Both are
    free, with the prior of the calibration around 1 and 0. With several calibrations their names
    contain the calibration id.
    """
    for error in errors:
        rows = error.rows[used]
        if float(error.calibration["relative_sd"]) and rows.any():
            suffix = "" if len(errors) == 1 else f"@{error.calibration['id']}"
            problem = _with_scale_error(problem, error.calibration, rows.astype(float), suffix)
    return problem


def _with_scale_error(
    problem: Problem, calibration: Mapping[str, Any], weight: Array, suffix: str
) -> Problem:
    predict_all, source = problem.predict, f"calibration {calibration['id']}"

    def nuisance(kind: str, unit: str, value: float, sd: float) -> tuple[str, Parameter]:
        parameter = Parameter(
            f"{kind}{suffix}", unit, value, value, prior=Prior("normal", value, sd, source),
            free=True, tolerance=sd, source=source,
        )  # fmt: skip
        return f"calibration.{parameter.name}", parameter

    def predict(values: Any) -> Any:
        scale, offset = 1.0 + weight * (values[-2] - 1.0), weight * values[-1]
        return scale * predict_all(values[:-2]) + offset

    scale = nuisance("scale", "1", 1.0, float(calibration["relative_sd"]))
    offset = nuisance("offset_N", "N", 0.0, TARED_ZERO_N)
    return replace(
        problem,
        predict=predict,
        parameters=Parameters((*problem.parameters.items(), scale, offset)),
        prior_parts={**problem.prior_parts, scale[0]: _parts(calibration)},
    )


def _parts(calibration: Mapping[str, Any]) -> tuple[ErrorSource, ...]:
    """Return the sources of a calibration's slope with their shares of its `relative_sd`."""
    total = float(calibration["relative_sd"])
    slope_only: list[dict[str, Any]] = [
        {
            "name": "repeat",
            "kind": "A",
            "unit": "1",
            "sd": total,
            "relative_sd": total,
            "distribution": "student_t",
            "dof": degrees_of_freedom(calibration),
        }
    ]
    return tuple(
        ErrorSource(
            name=f"calibration {calibration['id']}: {part['name']}",
            kind=part["kind"],
            unit=part["unit"],
            sd=float(part["sd"]),
            columns=np.array([[part["relative_sd"] / total]]),
            distribution=part.get("distribution", "normal"),
            dof=np.inf if part["dof"] is None else float(part["dof"]),
            origin=format_traceability(calibration),
            scatter=part.get("scatter", ""),
        )
        for part in calibration.get("components") or slope_only
        if part["relative_sd"] > 0.0
    )


PRIOR_LN = 0.7  # standard deviation of the logarithm of a stated walk, a factor of two; assumed
MIN_BINS = 8  # means at standstill, and samples of a mean; assumed
MAX_BINS = 240  # approximate number of means of a run, the rows of their covariance

BIN_S, SETTLED_S = 0.5, 0.4  # minimum duration of a mean; settling time after a stop; assumed


def run_zero_noise(path: str, rig: Rig) -> ZeroNoise:
    """Return the zero drift of data, with the random walk of a run estimated at standstill.

    Rotors stand still while the plate moves, so that the load cell reads its zero. The prior is the
    rig's value, which is returned without samples.
    """
    stated = zero_noise(rig)
    has_samples = is_run(path) and any(Path(path).glob("samples.*"))
    if not has_samples or "thrust_N" not in sample_names(path):
        return stated
    speed_names = [name for name in sample_names(path) if name.startswith("rpm")]
    means = standstill_means(read_samples(path, ["time_s", "phase", "thrust_N", *speed_names]))
    return stated if len(means) < MIN_BINS else estimate_zero_drift(means, stated)


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
