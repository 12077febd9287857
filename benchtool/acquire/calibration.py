"""Calibrate a load cell: read counts of known masses, fit the line, find its file again."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, sqrt
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.acquire.average import Average, average, read_span
from benchtool.bench.bench import Bench, Identity
from benchtool.core.array import Array
from benchtool.core.errors import CalibrationError
from benchtool.core.toml_text import FiniteTable, build
from benchtool.core.units import STANDARD_GRAVITY_M_S2
from benchtool.data.atomic import read_json
from benchtool.data.run.state import recall, state_file

WORST_STRAIGHTNESS = 0.02
"""Share of full scale that a residual may reach; beyond it a line does not describe the cell. A
choice: load cells are rated near 0.0005, and 0.02 is a loose screw or a wrong mass."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration(FiniteTable):
    """Turn raw counts into newtons: N = slope (counts - zero), zero from the tare.

    Attributes:
        id: date and device.
        date: when the masses hung, ISO 8601.
        device_id: the bench it belongs to.
        slope_N_per_count, offset_N: of N = slope counts + offset on the day.
        covariance: of (slope, offset), 2 by 2.
        relative_sd: standard deviation of the slope over the slope; common to every thrust.
        straightness, hysteresis: largest residual, and largest gap between up and down, as shares
            of full scale; hysteresis is None when the masses went one way only.
        masses_kg, counts: what hung and what was read, in order.
        residuals_N: what the line leaves over.
        lever_ratio: force on the cell over force at the rotor.
        gravity_m_s2: local acceleration of free fall.
    """

    id: str
    date: str
    device_id: str
    slope_N_per_count: float
    offset_N: float
    covariance: tuple[tuple[float, float], tuple[float, float]]
    relative_sd: float
    straightness: float
    hysteresis: float | None
    residual_sd_N: float
    masses_kg: tuple[float, ...]
    counts: tuple[float, ...]
    residuals_N: tuple[float, ...]
    lever_ratio: float = 1.0
    gravity_m_s2: float = STANDARD_GRAVITY_M_S2

    def newtons(self, counts: Array, zero_counts: float) -> Array:
        """Return thrust (n,): N, of raw counts (n,) against those of the unloaded cell."""
        return self.slope_N_per_count * (counts - zero_counts)


def fit_calibration(
    masses_kg: Array,
    counts: Array,
    *,
    date: str,
    device_id: str,
    lever_ratio: float = 1.0,
    gravity_m_s2: float = STANDARD_GRAVITY_M_S2,
) -> Calibration:
    """Fit the line through counts (n,) of masses (n,) in the order in which they hung.

    Counts carry the noise, so they are regressed on force, and the line is inverted; its
    covariance follows by the derivative.

    Args:
        masses_kg: known masses, several and more than once, up and then down.
        counts: mean raw reading of each.
        date: ISO 8601.
        lever_ratio: force on the cell over force where the rotor pulls; 1 for a straight mount.

    Raises:
        CalibrationError: too few masses, a reading that does not follow them, a line that bends.
    """
    force = _checked_forces(masses_kg, counts, lever_ratio, gravity_m_s2)
    n = len(force)
    centred = force - force.mean()
    spread = float(centred @ centred)
    gain = float(centred @ counts) / spread
    level = float(counts.mean() - gain * force.mean())
    residual_counts = counts - level - gain * force
    sd_counts = sqrt(float(residual_counts @ residual_counts) / (n - 2))
    gain_sd = sd_counts / sqrt(spread)
    if abs(gain) <= 5.0 * gain_sd or gain == 0.0:
        raise CalibrationError(
            f"the counts do not follow the masses ({gain:.3g} +- {gain_sd:.2g} counts per N); "
            f"check that the masses hang on the load cell and that its channel is connected"
        )
    slope, offset = 1.0 / gain, -level / gain
    residual_N = counts * slope + offset - force
    full_scale_N = float(np.ptp(force))
    straightness = float(np.abs(residual_N).max()) / full_scale_N
    worst = int(np.abs(residual_N).argmax())
    if straightness > WORST_STRAIGHTNESS:
        raise CalibrationError(
            f"{masses_kg[worst]:g} kg is {residual_N[worst]:+.3g} N off the line, "
            f"{100.0 * straightness:.1f} % of full scale, limit {100.0 * WORST_STRAIGHTNESS:g} %; "
            f"check that mass and how it hangs, then calibrate again"
        )
    by_gain = np.array([[-1.0 / gain**2, 0.0], [level / gain**2, -1.0 / gain]])
    design = np.column_stack([force, np.ones_like(force)])
    covariance = by_gain @ (sd_counts**2 * np.linalg.inv(design.T @ design)) @ by_gain.T
    return Calibration(
        id=f"{date}-{device_id}",
        date=date,
        device_id=device_id,
        slope_N_per_count=slope,
        offset_N=offset,
        covariance=tuple(tuple(row) for row in covariance.tolist()),  # type: ignore[arg-type]
        relative_sd=gain_sd / abs(gain),
        straightness=straightness,
        hysteresis=_hysteresis(force, residual_N),
        residual_sd_N=abs(slope) * sd_counts,
        masses_kg=tuple(masses_kg.tolist()),
        counts=tuple(counts.tolist()),
        residuals_N=tuple(residual_N.tolist()),
        lever_ratio=lever_ratio,
        gravity_m_s2=gravity_m_s2,
    )


def calibration_from(data: Mapping[str, Any], where: str) -> Calibration:
    """Return the calibration in a JSON object, checked key by key."""
    calibration = build(Calibration, data, where)
    if not (isfinite(calibration.slope_N_per_count) and calibration.slope_N_per_count != 0.0):
        raise CalibrationError(f"{where}: a slope of 0 N per count is none; calibrate again")
    return calibration


def require_device(
    calibration: Calibration, name: str, target: str, device_id: str, way_round: str
) -> None:
    """Refuse the calibration called `name` for a bench or a run, the target, of another device.

    Raises:
        CalibrationError: both devices, and the option that goes round it.
    """
    if calibration.device_id != device_id:
        raise CalibrationError(
            f"{name} was made on device {calibration.device_id!r}, but {target} is {device_id!r}; "
            f"calibrate this one, or give {way_round}"
        )


def _checked_forces(
    masses_kg: Array, counts: Array, lever_ratio: float, gravity_m_s2: float
) -> Array:
    if len(masses_kg) != len(counts):
        raise CalibrationError(f"{len(masses_kg)} masses, but {len(counts)} readings; pair them")
    if not (np.isfinite(masses_kg).all() and np.isfinite(counts).all()):
        raise CalibrationError("a mass or a reading is no number; mend or leave out that line")
    if (masses_kg < 0.0).any():
        raise CalibrationError(f"a mass of {masses_kg.min():g} kg is none; give masses in kg")
    if len(np.unique(masses_kg)) < 3:
        raise CalibrationError(
            f"{len(np.unique(masses_kg))} different masses cannot show whether the line is "
            f"straight; hang at least 3, better 5, up and down"
        )
    if not 9.76 < gravity_m_s2 < 9.84:
        raise CalibrationError(
            f"local gravity is {gravity_m_s2:g} m/s2, but on Earth's surface it lies from 9.76 to "
            f"9.84; correct --gravity"
        )
    if not 0.01 <= lever_ratio <= 100.0:
        raise CalibrationError(
            f"a lever ratio of {lever_ratio:g} is outside 0.01 to 100; give force on the cell over "
            f"force at the rotor"
        )
    return masses_kg * gravity_m_s2 / lever_ratio


def _hysteresis(force: Array, residual_N: Array) -> float | None:
    """Return the largest gap between the ways up and down at one force, over full scale."""
    top = int(force.argmax())
    gaps_N = []
    for level in np.unique(force):
        up = residual_N[: top + 1][force[: top + 1] == level]
        down = residual_N[top + 1 :][force[top + 1 :] == level]
        if len(up) and len(down):
            gaps_N.append(abs(float(up.mean() - down.mean())))
    return max(gaps_N) / float(np.ptp(force)) if gaps_N else None


def read_calibration(path: Path) -> Calibration:
    """Return the calibration in a JSON file."""
    return calibration_from(read_json(path), str(path))


def calibration_for(option: str | None, identity: Identity) -> Calibration | None:
    """Return the calibration for a device: the file given, its latest one, or none.

    Raises:
        CalibrationError: the file belongs to another device.
    """
    if option == "none":
        return None
    if option:
        calibration = read_calibration(Path(option))
        require_device(
            calibration, option, identity.address, identity.device_id, "--calibration none"
        )
        return calibration
    latest = recall("calibration", identity.device_id)
    if latest is None:
        return None
    return calibration_from(latest, str(state_file("calibration", identity.device_id)))


WAITED_S = 0.5
"""Samples older than the mass: thrown away after the operator's answer; a choice."""


def require_raw_counts(bench: Bench) -> int:
    """Return the column of the raw counts, or refuse a device that gives none."""
    names = [channel.name for channel in bench.identity.channels]
    if "thrust_raw" not in names:
        raise CalibrationError(
            f"{bench.identity.address} streams no raw counts (thrust_raw), so its newtons can only "
            f"be calibrated in its own firmware"
        )
    return names.index("thrust_raw")


def mean_counts(bench: Bench, seconds: float) -> Average:
    """Return the raw counts averaged over so long; motors are not touched.

    Raises:
        CalibrationError: the load cell gave no value.
    """
    column = require_raw_counts(bench)
    read_span(bench, WAITED_S)
    found = average(read_span(bench, seconds)[:, column])
    if found.n == 0:
        raise CalibrationError(
            f"the load cell gave no raw counts for {seconds:g} s; check its wiring"
        )
    return found
