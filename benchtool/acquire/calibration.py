"""Load cell calibration: counts of known masses, line fit, and recalibration of runs."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from math import sqrt
from pathlib import Path

import numpy as np

from benchtool.acquire.average import Average, average, read_span
from benchtool.acquire.inputs import WeighingInputs, user_name
from benchtool.acquire.plan import plan_from_toml
from benchtool.bench.bench import Bench, DeviceInfo
from benchtool.core.errors import CalibrationError, FileFormatError
from benchtool.core.recording import Recording
from benchtool.core.units import Array
from benchtool.data.atomic import data_hash
from benchtool.data.calibration import (
    Calibration,
    CalibrationComponent,
    parse_calibration,
    read_calibration,
)
from benchtool.data.columns import REJECTED, VALID_KINDS, word_to_code
from benchtool.data.run.points import load_settings, write_table
from benchtool.data.run.read import read_points, read_samples
from benchtool.data.run.run import Run
from benchtool.data.run.state import load_state, state_file

MAX_NONLINEARITY = 0.02  # residual over full scale; cells are rated 0.0005; assumed


@dataclass(frozen=True, slots=True)
class _Line:
    """Line of counts over force for one day, with residuals."""

    gain: float  # counts per N
    level: float  # counts
    squares_N2: float  # sum of squared deviations of force
    residual_counts: Array


def fit_calibration(
    masses_kg: Array,
    counts: Array,
    *,
    date: str,
    device_id: str,
    weighing: WeighingInputs | None = None,
    days: Sequence[str] = (),
) -> Calibration:
    """Fit a line through counts (n,) of masses (n,), in the order of loading.

    Counts carry the noise, so they are regressed on force and the line is inverted; its covariance
    follows by the derivative. Each day has its own line. The slope is the mean over days, and the
    scatter between days beyond their errors is a separate component, since a run is made on
    another day.

    Args:
        counts: mean raw reading of each mass.
        date: of the last reading, ISO 8601.
        days: (n,) day of each reading; default: one day.

    Raises:
        CalibrationError: too few masses, counts that do not depend on them, nonlinear readings.
    """
    weighing = weighing or WeighingInputs()
    force = _checked_forces(masses_kg, counts, weighing)
    labels = np.array(list(days) or [date[:10]] * len(force))
    if len(labels) != len(force):
        raise CalibrationError(f"{len(force)} readings, but {len(labels)} days; name one for each")
    by_day = {str(day): labels == day for day in dict.fromkeys(labels.tolist())}
    for day, rows in by_day.items():
        _check_masses(masses_kg[rows], f" on {day}" if len(by_day) > 1 else "")
    lines = [_fit_line(force[rows], counts[rows]) for rows in by_day.values()]
    dof = len(force) - 2 * len(lines)
    squares = sum(float(line.residual_counts @ line.residual_counts) for line in lines)
    gains = np.array([line.gain for line in lines])
    gain = float(gains.mean())
    sd_counts = sqrt(squares / dof)
    within = sd_counts**2 * float(np.mean([1.0 / line.squares_N2 for line in lines]))
    gain_sd = sqrt(within / len(lines))
    if abs(gain) <= 5.0 * gain_sd or gain == 0.0:
        raise CalibrationError(
            f"load cell gain {gain:.3g} +- {gain_sd:.2g} counts/N is not significant; "
            f"check that the masses hang on the load cell (a virtual bench has none) and that its "
            f"channel is connected"
        )
    residual_N = np.empty(len(force))
    for line, rows in zip(lines, by_day.values(), strict=True):
        residual_N[rows] = line.residual_counts / line.gain
    worst = int(np.abs(residual_N).argmax())
    straightness = float(np.abs(residual_N[worst]) / np.ptp(force))
    if straightness > MAX_NONLINEARITY:
        raise CalibrationError(
            f"{masses_kg[worst]:g} kg is {residual_N[worst]:+.3g} N off the line, "
            f"{100.0 * straightness:.1f} % of full scale, limit {100.0 * MAX_NONLINEARITY:g} %; "
            f"check that mass and its suspension, then calibrate again"
        )
    slope, last = 1.0 / gain, lines[-1]
    components = [
        CalibrationComponent(
            name="repeat",
            kind="A",
            unit="count",
            sd=sd_counts,
            relative_sd=0.0 if len(lines) > 1 else gain_sd / abs(gain),
            distribution="student_t",
            dof=dof,
        )
    ]
    if len(lines) > 1:
        # The scatter between days includes that of readings. A run is on another day.
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
    per_kg = _slope_per_kg([masses_kg[rows] for rows in by_day.values()], dof)
    components += _uncertainty_components(weighing, per_kg)
    by_gain = np.array([[-(slope**2), 0.0], [last.level * slope**2, -slope]])
    last_force = force[list(by_day.values())[-1]]
    design = np.column_stack([last_force, np.ones_like(last_force)])
    covariance = by_gain @ (sd_counts**2 * np.linalg.inv(design.T @ design)) @ by_gain.T
    gaps = [_hysteresis(force[rows], residual_N[rows]) for rows in by_day.values()]
    return Calibration(
        id=f"{date}-{device_id}",
        date=date,
        device_id=device_id,
        slope_N_per_count=slope,
        offset_N=-last.level * slope,
        covariance=tuple(tuple(row) for row in covariance.tolist()),  # type: ignore[arg-type]
        relative_sd=sqrt(sum(component.relative_sd**2 for component in components)),
        straightness=straightness,
        hysteresis=max((gap for gap in gaps if gap is not None), default=None),
        residual_sd_N=abs(slope) * sd_counts,
        masses_kg=tuple(masses_kg.tolist()),
        counts=tuple(counts.tolist()),
        residuals_N=tuple(residual_N.tolist()),
        lever_ratio=weighing.lever_ratio,
        gravity_m_s2=weighing.gravity,
        days=tuple(labels.tolist()),
        components=tuple(components),
        calibrated_by=weighing.operator or user_name(),
        certificate=weighing.certificate,
    )


def current_date() -> str:
    """Return date and time in the format of a calibration."""
    return datetime.now().astimezone().strftime("%Y-%m-%dT%H%M%S")


def _fit_line(force: Array, counts: Array) -> _Line:
    centred = force - force.mean()
    squares = float(centred @ centred)
    gain = float(centred @ counts) / squares
    level = float(counts.mean() - gain * force.mean())
    return _Line(gain, level, squares, counts - level - gain * force)


def _slope_per_kg(days_kg: Sequence[Array], dof: int) -> float:
    """Return the relative slope error from independent errors of 1 kg of every mass: 1/kg.

    A mass that is used several times has the same error each time; 0 kg has none. The residuals of
    such errors are already in the scatter of the readings and are subtracted.
    """
    change: dict[float, float] = {}
    residual2, slope_variance = 0.0, 0.0
    for masses_kg in days_kg:
        different = np.unique(masses_kg[masses_kg > 0.0])
        errors = (masses_kg[:, None] == different).astype(float)
        centred = masses_kg - masses_kg.mean()
        squares = float(centred @ centred)
        slopes = centred @ errors / squares
        for mass, slope in zip(different.tolist(), slopes.tolist(), strict=True):
            change[mass] = change.get(mass, 0.0) + slope / len(days_kg)
        residual2 += float(np.sum((errors - errors.mean(axis=0) - np.outer(centred, slopes)) ** 2))
        slope_variance += 1.0 / squares / len(days_kg) ** 2
    total = sum(slope**2 for slope in change.values())
    return sqrt(max(total - residual2 / dof * slope_variance, 0.0))


def _uncertainty_components(
    weighing: WeighingInputs, per_kg: float
) -> Iterator[CalibrationComponent]:
    """Yield the components of the slope's uncertainty; `per_kg` is that of `_slope_per_kg`."""
    u = weighing.uncertainty
    for name, unit, sd, relative_sd in (
        ("masses", "kg", u.mass_u_kg, u.mass_u_kg * per_kg),
        ("scale of the masses", "1", u.mass_scale_u, u.mass_scale_u),
        ("gravity", "m/s2", u.gravity_u_m_s2, u.gravity_u_m_s2 / weighing.gravity),
        ("lever", "1", u.lever_u, u.lever_u / weighing.lever_ratio),
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
    weighing: WeighingInputs,
) -> tuple[Array, Array, list[str]]:
    """Return masses, counts and days of an earlier calibration followed by new readings.

    Raises:
        CalibrationError: made with another lever or gravity.
    """
    earlier_values = (earlier.lever_ratio, earlier.gravity_m_s2)
    new_values = (weighing.lever_ratio, weighing.gravity)
    if earlier_values != new_values:
        raise CalibrationError(
            f"calibration {earlier.id} was made with lever ratio and gravity {earlier_values}, "
            f"these readings with {new_values}; use the same values"
        )
    days = list(earlier.days) or [earlier.date[:10]] * len(earlier.masses_kg)
    return (
        np.concatenate([earlier.masses_kg, masses_kg]),
        np.concatenate([earlier.counts, counts]),
        [*days, *[day] * len(masses_kg)],
    )


def require_device(
    calibration: Calibration, name: str, target: str, device_id: str, override: str
) -> None:
    """Raise CalibrationError for a calibration of another device than that of a bench or run."""
    if calibration.device_id != device_id:
        raise CalibrationError(
            f"{name} was made on device {calibration.device_id!r}, but {target} is {device_id!r}; "
            f"calibrate this one, or give {override}"
        )


def _checked_forces(masses_kg: Array, counts: Array, weighing: WeighingInputs) -> Array:
    if len(masses_kg) != len(counts):
        raise CalibrationError(f"{len(masses_kg)} masses, but {len(counts)} readings; pair them")
    if not (np.isfinite(masses_kg).all() and np.isfinite(counts).all()):
        raise CalibrationError("a mass or reading is not finite; correct or remove that line")
    if (masses_kg < 0.0).any():
        raise CalibrationError(
            f"mass {masses_kg.min():g} kg is out of range; allowed: 0 kg or more"
        )
    return masses_kg * weighing.gravity / weighing.lever_ratio


def _check_masses(masses_kg: Array, when: str) -> None:
    if (different := len(np.unique(masses_kg))) < 3:
        raise CalibrationError(
            f"{different} different masses{when} are too few to check linearity; use at least 3, "
            f"better 5, up and down"
        )


def _hysteresis(force: Array, residual_N: Array) -> float | None:
    """Return the largest difference between loading and unloading, relative to full scale."""
    top = int(force.argmax())
    gaps_N = []
    for level in np.unique(force):
        up = residual_N[: top + 1][force[: top + 1] == level]
        down = residual_N[top + 1 :][force[top + 1 :] == level]
        if len(up) and len(down):
            gaps_N.append(abs(float(up.mean() - down.mean())))
    return max(gaps_N) / float(np.ptp(force)) if gaps_N else None


def find_calibration(option: str | None, identity: DeviceInfo) -> Calibration | None:
    """Return the calibration for a device: the given file, the latest one, or none."""
    if option == "none":
        return None
    if option:
        calibration = read_calibration(Path(option))
        require_device(
            calibration, option, identity.address, identity.device_id, "--calibration none"
        )
        return calibration
    latest = load_state("calibration", identity.device_id)
    if latest is None:
        return None
    return parse_calibration(latest, str(state_file("calibration", identity.device_id)))


RAW_COUNTS_TIMEOUT_S = 0.5  # samples discarded after the operator's answer; assumed


def require_raw_counts(bench: Bench) -> int:
    """Return the column of the raw counts; raise CalibrationError without one."""
    names = [channel.name for channel in bench.identity.channels]
    if "thrust_raw" not in names:
        raise CalibrationError(
            f"{bench.identity.address} streams no raw counts (thrust_raw); calibrate it in its "
            f"firmware"
        )
    return names.index("thrust_raw")


def mean_counts(bench: Bench, seconds: float) -> Average:
    """Return the average of the raw counts over a duration; motors are not commanded."""
    column = require_raw_counts(bench)
    read_span(bench, RAW_COUNTS_TIMEOUT_S)
    mean = average(read_span(bench, seconds)[:, column])
    if mean.n == 0:
        raise CalibrationError(f"no raw counts within {seconds:g} s; check the load cell's wiring")
    return mean


def recalibrate(run: Run, calibration: Calibration, *, other_device: bool = False) -> Path:
    """Write recalibrated points and settings to RUN/recalibrated-ID; return that folder.

    The folder is read like a run: `benchtool fit RUN/recalibrated-ID`.

    Args:
        other_device: allow a calibration of another device; recorded in the metadata.

    Raises:
        CalibrationError: calibration of another device, or run without raw counts or tare.
        WouldOverwrite: the folder exists.
    """
    metadata = run.metadata
    device_id = str(metadata.get("device_id", ""))
    if not other_device:
        name = f"calibration {calibration.id}"
        require_device(calibration, name, f"run {run.path}", device_id, "--other-device")
    samples = read_samples(run.path, ["time_s", "point", "phase", "thrust_raw"])
    if "thrust_raw" not in samples or np.isnan(samples.column("thrust_raw")).all():
        raise CalibrationError(
            f"{run.path} has no raw counts (thrust_raw), which a recalibration needs"
        )
    points = read_points(run.path, VALID_KINDS)
    plan = plan_from_toml(run.plan_text, str(run.path / "plan.toml"))
    quantum_N = float(metadata["rig"].get("sensors", {}).get("thrust_N", {}).get("quantum", 0.0))
    recalibrated = _recompute(points, samples, calibration, plan.tare.seconds, quantum_N)
    metadata |= {
        "calibration": asdict(calibration),
        "calibration_of_other_device": calibration.device_id != device_id,
        "recalibrated_from": {"run": run.path.name, "sha256": data_hash(run.path)},
        "samples": {},
        "points": {},
    }
    name = re.sub(r"[^A-Za-z0-9._-]", "_", calibration.id)
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
