"""Apply a calibration to a run that is on disk, without touching its raw data."""

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
from benchtool.data.run.points import write_table
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import Run
from benchtool.data.run.settings import load_settings


def recalibrate(run: Run, calibration: Calibration, *, other_device: bool = False) -> Path:
    """Write points and settings through a calibration to RUN/recalibrated-ID; return that folder.

    The folder is read like a run: `benchtool fit RUN/recalibrated-ID`.

    Args:
        other_device: take one of another device all the same; the metadata record it.

    Raises:
        CalibrationError: the calibration belongs to another device, the run has no raw counts,
            or no tare to count from.
        WouldOverwrite: the run was recalibrated so before.
    """
    device_id = str(run.metadata.get("device_id", ""))
    if not other_device:
        name = f"calibration {calibration.id}"
        require_device(calibration, name, f"run {run.path}", device_id, "--other-device")
    samples = read_samples(run.path, ["time_s", "point", "phase", "thrust_raw"])
    if "thrust_raw" not in samples or np.isnan(samples.column("thrust_raw")).all():
        raise CalibrationError(
            f"{run.path} holds no raw counts (thrust_raw), so no other calibration can be applied"
        )
    points = read_points(run.path, VALID_KINDS)
    facts = run.metadata
    plan = plan_from_toml(run.plan_text, str(run.path / "plan.toml"))
    quantum_N = float(facts["rig"].get("sensors", {}).get("thrust_N", {}).get("quantum", 0.0))
    fresh = _recomputed(points, samples, calibration, plan.tare.seconds, quantum_N)
    name = re.sub(r"[^A-Za-z0-9._-]", "_", calibration.id)
    facts |= {
        "calibration": asdict(calibration),
        "calibration_of_other_device": calibration.device_id != device_id,
        "recalibrated_from": {"run": run.path.name, "sha256": data_hash(run.path)},
        "samples": {},
        "points": {},
    }
    anew = Run.create(run.path / f"recalibrated-{name}", run.plan_text, facts)
    anew.write_points(fresh)
    write_table(anew.path / "settings.csv", load_settings(anew.path, fresh))
    return anew.path


def _recomputed(
    points: Recording, samples: Recording, calibration: Calibration, tare_s: float, quantum_N: float
) -> Recording:
    raw = samples.column("thrust_raw")
    time_s, phase = samples.column("time_s"), samples.column("phase")
    number = samples.column("point")
    kinds = points.column("kind")
    values = points.values.copy()
    names = ["thrust_N", "thrust_sd_N", "thrust_se_N", "n_samples"]
    # Runs of versions that left no outliers out have no such column.
    names += [name for name in [f"thrust_N{REJECTED}"] if name in points]
    columns = [points.index(name) for name in names]
    zero = np.nan
    for row in range(len(points)):
        if kinds[row] == word_to_code("kind", "tare"):
            near = np.abs(time_s - points.column("time_s")[row]) <= 0.5 * tare_s
            chosen = near & (phase == word_to_code("phase", "tare"))
            zero = average(raw[chosen]).mean
        else:
            own = number == points.column("point")[row]
            # A visit that was measured again settled before each try; the last one counts.
            settling = own & (phase == word_to_code("phase", "settle"))
            begun_s = time_s[settling].max(initial=-np.inf)
            chosen = own & (phase == word_to_code("phase", "sample")) & (time_s > begun_s)
        if np.isnan(zero):
            raise CalibrationError(
                "the run holds no raw counts of a tare before its first point, so nothing gives "
                "the counts of the unloaded cell"
            )
        if not chosen.any():
            raise FileFormatError(
                "samples.csv", f"no samples of point {points.column('point')[row]:.0f} are in it"
            )
        thrust = average(calibration.newtons(raw[chosen], zero), quantum_N)
        found = [thrust.mean, thrust.sd, thrust.se, thrust.n, thrust.n_rejected]
        values[row, columns] = found[: len(columns)]
    return replace(points, values=values)
