"""Load cell calibration, as in its file and in run metadata, its age limit, and zero drift."""

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
from benchtool.core.rig import Rig, Sensor
from benchtool.core.toml_text import FiniteTable, build_dataclass
from benchtool.core.units import STANDARD_GRAVITY_M_S2, Array
from benchtool.data.atomic import read_json


@dataclass(frozen=True, slots=True, kw_only=True)
class CalibrationComponent(FiniteTable):
    """One source of the slope's uncertainty."""

    name: str
    kind: EvaluationType  # evaluation (JCGM 100:2008, 3.3): "A" from scatter, "B" otherwise
    unit: str
    sd: float  # standard uncertainty of the source in `unit`
    relative_sd: float  # its contribution to the slope, over the slope
    distribution: Literal["normal", "student_t"] = "normal"
    dof: float | None = None  # degrees of freedom of `sd`; None if `sd` is a given value


@dataclass(frozen=True, slots=True, kw_only=True)
class Calibration(FiniteTable):
    """Linear load cell calibration: N = slope (counts - zero), zero from the tare."""

    id: str
    date: str  # of the last masses, ISO 8601
    device_id: str
    slope_N_per_count: float  # of N = slope counts + offset on the last day
    offset_N: float
    covariance: tuple[tuple[float, float], tuple[float, float]]  # 2 by 2, of slope and offset
    relative_sd: float  # of the slope, by all components; common to every thrust
    straightness: float  # largest residual over full scale
    hysteresis: float | None  # largest gap over full scale; None if masses are only added
    residual_sd_N: float  # of the readings about the line of their day
    masses_kg: tuple[float, ...]  # of the measurements, in order
    counts: tuple[float, ...]  # readings
    residuals_N: tuple[float, ...]  # about the line of the day
    lever_ratio: float = 1.0  # force on the load cell over force at the rotor
    gravity_m_s2: float = STANDARD_GRAVITY_M_S2
    days: tuple[str, ...] = ()  # of each measurement
    components: tuple[CalibrationComponent, ...] = ()  # of `relative_sd`; none in old files
    calibrated_by: str = ""
    certificate: str = ""  # traceability of the masses

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


DECADES_S = tuple(10.0**power for power in np.arange(-0.5, 5.0))  # 1/f noise, flat in 5 %


@dataclass(frozen=True, slots=True)
class ZeroNoise:
    """Parameters of the zero drift of a load cell."""

    walk: float = 0.0  # standard deviation of its random walk after one second: N/sqrt(s)
    flicker: float = 0.0  # standard deviation of its 1/f noise over one decade of frequency: N
    dof: float = np.inf  # degrees of freedom of the estimated walk; infinite if it is from the rig


def zero_covariance(since_s: Array, noise: ZeroNoise) -> Array:
    """Return the covariance (m, m) of the zero drift, at times (m,) since the last known zero: N2.

    A random walk has w^2 min(t, t'). 1/f noise is a sum of Ornstein-Uhlenbeck processes of equal
    variance, with time constants a decade apart (Kasdin, Proc. IEEE 83, 1995), minus its value at
    the last known zero.
    """
    t = np.concatenate([[0.0], since_s])
    lag_s = np.abs(t[:, None] - t)
    process = np.sum([np.exp(-lag_s / tau) for tau in DECADES_S], axis=0) * noise.flicker**2
    flicker = process[1:, 1:] - process[1:, :1] - process[:1, 1:] + process[0, 0]
    covariance: Array = noise.walk**2 * np.minimum(since_s[:, None], since_s) + flicker
    return covariance


def zero_variance(since_s: Array, noise: ZeroNoise) -> Array:
    """Return the diagonal (m,) of `zero_covariance`: N2."""
    decayed = np.sum([np.exp(-since_s / tau) for tau in DECADES_S], axis=0)
    flicker = 2.0 * noise.flicker**2 * (len(DECADES_S) - decayed)
    return np.asarray(noise.walk**2 * since_s + flicker, float)


def zero_noise(rig: Rig) -> ZeroNoise:
    """Return the zero drift that a rig states."""
    load_cell = rig.sensors.get("thrust_N", Sensor())
    return ZeroNoise(load_cell.walk, load_cell.flicker)
