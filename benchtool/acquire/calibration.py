"""Calibrate a load cell: read counts of known masses, fit the line, find its file again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from math import sqrt
from pathlib import Path

import numpy as np

from benchtool.acquire.average import Average, average, read_span
from benchtool.acquire.inputs import MassUncertainty, WeighingInputs
from benchtool.acquire.run_creation import user_name
from benchtool.bench.bench import Bench, DeviceInfo
from benchtool.core.array_type import Array
from benchtool.core.errors import CalibrationError
from benchtool.core.units import STANDARD_GRAVITY_M_S2
from benchtool.data.calibration import (
    Calibration,
    CalibrationComponent,
    parse_calibration,
    read_calibration,
)
from benchtool.data.run.state import recall_latest, state_file

MAX_NONLINEARITY = 0.02  # residual over full scale; cells are rated 0.0005; assumed


@dataclass(frozen=True, slots=True)
class _Line:
    """Hold the line of counts over force of one day, and what it leaves over."""

    gain: float  # counts per N
    level: float  # counts
    spread: float  # sum of the squared deviations of force, N2
    residual_counts: Array


def fit_calibration(
    masses_kg: Array,
    counts: Array,
    *,
    date: str,
    device_id: str,
    lever_ratio: float = 1.0,
    gravity_m_s2: float = STANDARD_GRAVITY_M_S2,
    days: Sequence[str] = (),
    uncertainty: MassUncertainty | None = None,
    calibrated_by: str = "",
    certificate: str = "",
) -> Calibration:
    """Fit the line through counts (n,) of masses (n,) in the order in which they hung.

    Counts carry the noise, so they are regressed on force, and the line is inverted; its
    covariance follows by the derivative. Each day has its own line; the slope is the mean of
    theirs, and what they differ by beyond their own errors is a component of its own, for the day
    of a run is another one.

    Args:
        counts: mean raw reading of each.
        date: of the last reading, ISO 8601.
        lever_ratio: force on the cell over force where the rotor pulls; 1 for a straight mount.
        days: (n,) day of each reading; all of the same one when left out.
        uncertainty: of masses, gravity and lever; taken as exact when left out.

    Raises:
        CalibrationError: too few masses, a reading that does not follow them, a line that bends.
    """
    force = _checked_forces(masses_kg, counts, lever_ratio, gravity_m_s2)
    labels = np.array(list(days) or [date[:10]] * len(force))
    if len(labels) != len(force):
        raise CalibrationError(f"{len(force)} readings, but {len(labels)} days; name one for each")
    each = {str(day): labels == day for day in dict.fromkeys(labels.tolist())}
    for day, rows in each.items():
        _check_masses(masses_kg[rows], f" on {day}" if len(each) > 1 else "")
    lines = [_line(force[rows], counts[rows]) for rows in each.values()]
    dof = len(force) - 2 * len(lines)
    squares = sum(float(line.residual_counts @ line.residual_counts) for line in lines)
    gains = np.array([line.gain for line in lines])
    gain = float(gains.mean())
    sd_counts = sqrt(squares / dof)
    within = sd_counts**2 * float(np.mean([1.0 / line.spread for line in lines]))
    gain_sd = sqrt(within / len(lines))
    if abs(gain) <= 5.0 * gain_sd or gain == 0.0:
        raise CalibrationError(
            f"the counts do not follow the masses ({gain:.3g} +- {gain_sd:.2g} counts per N); "
            f"check that the masses hang on the load cell and that its channel is connected"
        )
    residual_N = np.empty(len(force))
    for line, rows in zip(lines, each.values(), strict=True):
        residual_N[rows] = line.residual_counts / line.gain
    full_scale_N = float(np.ptp(force))
    straightness = float(np.abs(residual_N).max()) / full_scale_N
    worst = int(np.abs(residual_N).argmax())
    if straightness > MAX_NONLINEARITY:
        raise CalibrationError(
            f"{masses_kg[worst]:g} kg is {residual_N[worst]:+.3g} N off the line, "
            f"{100.0 * straightness:.1f} % of full scale, limit {100.0 * MAX_NONLINEARITY:g} %; "
            f"check that mass and how it hangs, then calibrate again"
        )
    slope, last = 1.0 / gain, lines[-1]
    repeat = CalibrationComponent(
        name="repeat",
        kind="A",
        unit="count",
        sd=sd_counts,
        relative_sd=0.0 if len(lines) > 1 else gain_sd / abs(gain),
        distribution="student_t",
        dof=dof,
    )
    components = [repeat]
    if len(lines) > 1:
        # Scatter of the days' gains holds that of their readings already. A run is on another day.
        scatter = float(gains.var(ddof=1))
        between = max(0.0, scatter - within)
        sd = sqrt(scatter * (1.0 + 1.0 / len(lines))) / abs(gain)
        components.append(
            CalibrationComponent(
                name="days",
                kind="A",
                unit="1",
                sd=sqrt(between) / abs(gain),
                relative_sd=sd,
                distribution="student_t",
                dof=len(lines) - 1,
            )
        )
    known = uncertainty or MassUncertainty()
    per_kg = _slope_per_kg([masses_kg[rows] for rows in each.values()], dof)
    components += _stated(known, per_kg, lever_ratio, gravity_m_s2)
    by_gain = np.array([[-(slope**2), 0.0], [last.level * slope**2, -slope]])
    last_force = force[list(each.values())[-1]]
    design = np.column_stack([last_force, np.ones_like(last_force)])
    covariance = by_gain @ (sd_counts**2 * np.linalg.inv(design.T @ design)) @ by_gain.T
    hysteresis = [_hysteresis(force[rows], residual_N[rows]) for rows in each.values()]
    return Calibration(
        id=f"{date}-{device_id}",
        date=date,
        device_id=device_id,
        slope_N_per_count=slope,
        offset_N=-last.level * slope,
        covariance=tuple(tuple(row) for row in covariance.tolist()),  # type: ignore[arg-type]
        relative_sd=sqrt(sum(one.relative_sd**2 for one in components)),
        straightness=straightness,
        hysteresis=max((gap for gap in hysteresis if gap is not None), default=None),
        residual_sd_N=abs(slope) * sd_counts,
        masses_kg=tuple(masses_kg.tolist()),
        counts=tuple(counts.tolist()),
        residuals_N=tuple(residual_N.tolist()),
        lever_ratio=lever_ratio,
        gravity_m_s2=gravity_m_s2,
        days=tuple(labels.tolist()),
        components=tuple(components),
        calibrated_by=calibrated_by,
        certificate=certificate,
    )


def current_date() -> str:
    """Return date and time as a calibration holds them."""
    return datetime.now().astimezone().strftime("%Y-%m-%dT%H%M%S")


def apply_calibration(
    masses_kg: Array,
    counts: Array,
    device_id: str,
    date: str,
    known: WeighingInputs,
    days: Sequence[str] = (),
) -> Calibration:
    """Return the calibration of masses (n,) and counts (n,) with what is known of them."""
    return fit_calibration(
        masses_kg,
        counts,
        date=date,
        device_id=device_id,
        lever_ratio=known.lever_ratio,
        gravity_m_s2=known.gravity,
        days=days,
        uncertainty=known.uncertainty,
        calibrated_by=known.operator or user_name(),
        certificate=known.certificate,
    )


def _line(force: Array, counts: Array) -> _Line:
    centred = force - force.mean()
    spread = float(centred @ centred)
    gain = float(centred @ counts) / spread
    level = float(counts.mean() - gain * force.mean())
    return _Line(gain, level, spread, counts - level - gain * force)


def _slope_per_kg(days_kg: Sequence[Array], dof: int) -> float:
    """Return what errors of 1 kg of every mass by itself make of the slope, over the slope: 1/kg.

    A mass that hung several times had the same error each time; nothing hung at 0 kg. What such
    errors leave over of the lines is in the scatter of the readings already, and is taken off.
    """
    moved: dict[float, float] = {}
    left, spread = 0.0, 0.0
    for masses_kg in days_kg:
        different = np.unique(masses_kg[masses_kg > 0.0])
        errors = (masses_kg[:, None] == different).astype(float)
        centred = masses_kg - masses_kg.mean()
        squares = float(centred @ centred)
        slopes = centred @ errors / squares
        for mass, slope in zip(different.tolist(), slopes.tolist(), strict=True):
            moved[mass] = moved.get(mass, 0.0) + slope / len(days_kg)
        left += float(np.sum((errors - errors.mean(axis=0) - np.outer(centred, slopes)) ** 2))
        spread += 1.0 / squares / len(days_kg) ** 2
    return sqrt(max(sum(slope**2 for slope in moved.values()) - left / dof * spread, 0.0))


def _stated(
    known: MassUncertainty, per_kg: float, lever_ratio: float, gravity_m_s2: float
) -> Iterator[CalibrationComponent]:
    """Give what the stated uncertainties make of the slope.

    Args:
        per_kg: relative change of the slope by errors of 1 kg of each mass.
    """
    for name, unit, sd, relative_sd in (
        ("masses", "kg", known.mass_u_kg, known.mass_u_kg * per_kg),
        ("scale of the masses", "1", known.mass_scale_u, known.mass_scale_u),
        ("gravity", "m/s2", known.gravity_u_m_s2, known.gravity_u_m_s2 / gravity_m_s2),
        ("lever", "1", known.lever_u, known.lever_u / lever_ratio),
    ):
        if sd > 0.0:
            yield CalibrationComponent(
                name=name, kind="B", unit=unit, sd=sd, relative_sd=relative_sd
            )


def with_drift_interval(
    earlier: Calibration,
    masses_kg: Array,
    counts: Array,
    day: str,
    lever_ratio: float,
    gravity_m_s2: float,
) -> tuple[Array, Array, list[str]]:
    """Return masses, counts and days of an earlier calibration followed by new readings.

    Raises:
        CalibrationError: it was made with another lever or gravity.
    """
    theirs, own = (earlier.lever_ratio, earlier.gravity_m_s2), (lever_ratio, gravity_m_s2)
    if theirs != own:
        raise CalibrationError(
            f"calibration {earlier.id} was made with lever ratio and gravity {theirs}, these "
            f"readings with {own}; give the same ones"
        )
    days = list(earlier.days) or [earlier.date[:10]] * len(earlier.masses_kg)
    return (
        np.concatenate([earlier.masses_kg, masses_kg]),
        np.concatenate([earlier.counts, counts]),
        [*days, *[day] * len(masses_kg)],
    )


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


def _check_masses(masses_kg: Array, when: str) -> None:
    if (different := len(np.unique(masses_kg))) < 3:
        raise CalibrationError(
            f"{different} different masses{when} cannot show whether the line is straight; hang at "
            f"least 3, better 5, up and down"
        )


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


def calibration_for(option: str | None, identity: DeviceInfo) -> Calibration | None:
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
    latest = recall_latest("calibration", identity.device_id)
    if latest is None:
        return None
    return parse_calibration(latest, str(state_file("calibration", identity.device_id)))


RAW_COUNTS_TIMEOUT_S = (
    0.5  # samples older than the mass: thrown away after the operator's answer; assumed
)


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
    read_span(bench, RAW_COUNTS_TIMEOUT_S)
    found = average(read_span(bench, seconds)[:, column])
    if found.n == 0:
        raise CalibrationError(
            f"the load cell gave no raw counts for {seconds:g} s; check its wiring"
        )
    return found
