"""Recalibration of a run; the raw data are not changed."""

from __future__ import annotations

import re
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from benchtool.acquire.average import average
from benchtool.acquire.calibration import require_device
from benchtool.acquire.plan import plan_from_toml
from benchtool.core.errors import CalibrationError, FileFormatError
from benchtool.core.recording import Recording
from benchtool.data.atomic import data_hash
from benchtool.data.calibration import Calibration
from benchtool.data.columns import REJECTED, VALID_KINDS, word_to_code
from benchtool.data.run.points import load_settings, write_table
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import Run


def recalibrate(run: Run, calibration: Calibration, *, other_device: bool = False) -> Path:
    """Write recalibrated points and settings to RUN/recalibrated-ID; return that folder.

    The folder is read like a run: `benchtool fit RUN/recalibrated-ID`.

    Args:
        other_device: allow a calibration of another device; recorded in the metadata.

    Raises:
        CalibrationError: calibration of another device, or run without raw counts or tare.
        WouldOverwrite: the folder exists.
    """
    device_id = str(run.metadata.get("device_id", ""))
    if not other_device:
        name = f"calibration {calibration.id}"
        require_device(calibration, name, f"run {run.path}", device_id, "--other-device")
    samples = read_samples(run.path, ["time_s", "point", "phase", "thrust_raw"])
    if "thrust_raw" not in samples or np.isnan(samples.column("thrust_raw")).all():
        raise CalibrationError(
            f"{run.path} has no raw counts (thrust_raw), which a recalibration needs"
        )
    points = read_points(run.path, VALID_KINDS)
    metadata = run.metadata
    plan = plan_from_toml(run.plan_text, str(run.path / "plan.toml"))
    quantum_N = float(metadata["rig"].get("sensors", {}).get("thrust_N", {}).get("quantum", 0.0))
    recalibrated = _recompute(points, samples, calibration, plan.tare.seconds, quantum_N)
    name = re.sub(r"[^A-Za-z0-9._-]", "_", calibration.id)
    metadata |= {
        "calibration": asdict(calibration),
        "calibration_of_other_device": calibration.device_id != device_id,
        "recalibrated_from": {"run": run.path.name, "sha256": data_hash(run.path)},
        "samples": {},
        "points": {},
    }
    new_run = Run.create(run.path / f"recalibrated-{name}", run.plan_text, metadata)
    new_run.write_points(recalibrated)
    write_table(new_run.path / "settings.csv", load_settings(new_run.path, recalibrated))
    return new_run.path


def _recompute(
    points: Recording, samples: Recording, calibration: Calibration, tare_s: float, quantum_N: float
) -> Recording:
    raw = samples.column("thrust_raw")
    time_s, phase = samples.column("time_s"), samples.column("phase")
    number = samples.column("point")
    kinds = points.column("kind")
    values = points.values.copy()
    names = ["thrust_N", "thrust_sd_N", "thrust_se_N", "n_samples"]
    # Runs of older versions have no such column.
    names += [name for name in [f"thrust_N{REJECTED}"] if name in points]
    columns = [points.index(name) for name in names]
    zero = np.nan
    for row in range(len(points)):
        if kinds[row] == word_to_code("kind", "tare"):
            is_near = np.abs(time_s - points.column("time_s")[row]) <= 0.5 * tare_s
            selected = is_near & (phase == word_to_code("phase", "tare"))
            zero = average(raw[selected]).mean
        else:
            in_point = number == points.column("point")[row]
            # Repeated attempts settle again; the last attempt counts.
            settling = in_point & (phase == word_to_code("phase", "settle"))
            start_s = time_s[settling].max(initial=-np.inf)
            selected = in_point & (phase == word_to_code("phase", "sample")) & (time_s > start_s)
        if np.isnan(zero):
            raise CalibrationError(
                "no raw counts of a tare before the first point, needed for the counts of the "
                "unloaded cell"
            )
        if not selected.any():
            raise FileFormatError(
                "samples.csv", f"no samples of point {points.column('point')[row]:.0f}"
            )
        thrust = average(calibration.newtons(raw[selected], zero), quantum_N)
        statistics = [thrust.mean, thrust.sd, thrust.se, thrust.n, thrust.n_rejected]
        values[row, columns] = statistics[: len(columns)]
    return replace(points, values=values)
