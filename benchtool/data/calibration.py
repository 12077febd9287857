"""Load cell calibration, as in its file and in run metadata, and its age limit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from datetime import datetime
from math import inf, isfinite
from pathlib import Path
from typing import Any, Literal

import numpy as np

from benchtool.core.choices import EvaluationType
from benchtool.core.error_source import effective_dof
from benchtool.core.errors import CalibrationError
from benchtool.core.rig import Sensor
from benchtool.core.toml_text import FiniteTable, build_dataclass
from benchtool.core.units import STANDARD_GRAVITY_M_S2, Array
from benchtool.data.atomic import read_json


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationComponent(FiniteTable):
    """One source of the slope's uncertainty.

    Attributes:
        kind: type of evaluation (JCGM 100:2008, 3.3): "A" from scatter, "B" otherwise.
        sd: standard uncertainty of the source in `unit`.
        relative_sd: its contribution to the slope, over the slope.
        dof: degrees of freedom of `sd`; None if `sd` is a given value.
    """

    name: str
    kind: EvaluationType
    unit: str
    sd: float
    relative_sd: float
    distribution: Literal["normal", "student_t"] = "normal"
    dof: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration(FiniteTable):
    """Linear load cell calibration: N = slope (counts - zero), zero from the tare.

    Attributes:
        date: of the last masses, ISO 8601.
        slope_N_per_count, offset_N: of N = slope counts + offset on the last day.
        covariance: of (slope, offset) by the scatter about the line of that day, 2 by 2.
        relative_sd: standard uncertainty of the slope over the slope, by all components; common to
            every thrust.
        straightness, hysteresis: largest residual, and largest gap between loading and unloading,
            as shares of full scale; hysteresis is None for masses in one direction only.
        residual_sd_N: of the readings about the line of their day.
        masses_kg, counts, days: mass, reading and day of each measurement, in order.
        residuals_N: about the line of the day.
        lever_ratio: force on the load cell over force at the rotor.
        components: independent sources of `relative_sd`; none in files of earlier versions.
        calibrated_by, certificate: operator, and traceability of the masses.
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
    days: tuple[str, ...] = ()
    components: tuple[CalibrationComponent, ...] = ()
    calibrated_by: str = ""
    certificate: str = ""

    def newtons(self, counts: Array, zero_counts: float) -> Array:
        """Return thrust (n,): N, of raw counts (n,) minus those of the unloaded load cell."""
        return self.slope_N_per_count * (counts - zero_counts)

    @property
    def dof(self) -> float:
        """Effective degrees of freedom of `relative_sd` (Welch-Satterthwaite, GUM G.2b).

        Without components: those of the fitted line.
        """
        return degrees_of_freedom(asdict(self))

    def relative_half_width(self, probability: float) -> float:
        """Return the relative half width of the slope's interval for a coverage probability."""
        from scipy.special import stdtrit

        return float(stdtrit(self.dof, 0.5 + 0.5 * probability)) * self.relative_sd


def degrees_of_freedom(calibration: Mapping[str, Any]) -> float:
    """Return the effective degrees of freedom of a calibration's `relative_sd`."""
    parts = calibration.get("components")
    if not parts:
        return max(float(len(calibration["masses_kg"]) - 2), 1.0)
    dof = [inf if component["dof"] is None else component["dof"] for component in parts]
    return effective_dof(np.array([component["relative_sd"] for component in parts]), np.array(dof))


def parse_calibration(data: Mapping[str, Any], where: str) -> Calibration:
    """Return the calibration in a JSON object, checked key by key."""
    calibration = build_dataclass(Calibration, data, where)
    if not (isfinite(calibration.slope_N_per_count) and calibration.slope_N_per_count != 0.0):
        raise CalibrationError(f"{where}: slope is 0 N per count or not finite; calibrate again")
    return calibration


def read_calibration(path: Path) -> Calibration:
    """Return the calibration in a JSON file."""
    return parse_calibration(read_json(path), str(path))


def format_traceability(calibration: Mapping[str, Any]) -> str:
    """Return one sentence with operator, date and certificate of the calibration."""
    by = calibration.get("calibrated_by") or "an unnamed operator"
    certificate = calibration.get("certificate")
    with_ = f"certificate {certificate}" if certificate else "no certificate stated"
    return f"calibration {calibration['id']}: by {by} on {calibration['date']}, {with_}"


def format_age_warning(metadata: Mapping[str, Any]) -> str:
    """Return a warning if the calibration was too old when the run began, else "".

    Without a calibration or without readable dates in the run's metadata the result is "".
    """
    calibration = metadata.get("calibration") or {}
    sensor = ((metadata.get("rig") or {}).get("sensors") or {}).get("thrust_N") or {}
    limit_days = float(sensor.get("valid_days", Sensor().valid_days))
    try:
        made = datetime.fromisoformat(str(calibration.get("date"))).replace(tzinfo=None)
        began = datetime.fromisoformat(str(metadata.get("started"))).replace(tzinfo=None)
    except ValueError:
        return ""
    age_days = (began - made).total_seconds() / 86400.0
    if age_days <= limit_days:
        return ""
    return (
        f"calibration {calibration['id']} was {age_days:.0f} days old when the run began, limit "
        f"{limit_days:g} (sensors.thrust_N.valid_days of the rig); calibrate again, then "
        f"benchtool calibrate --apply RUN"
    )
