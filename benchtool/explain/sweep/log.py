"""Sweep log of a recording of points, prepared for comparison with a model, and its supply."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import InputError
from benchtool.core.recording import Recording, check_rotor_count
from benchtool.core.rig import Rig, Sensor
from benchtool.core.text import pluralize
from benchtool.core.units import Array
from benchtool.data.calibration import ZeroNoise
from benchtool.data.columns import word_to_code
from benchtool.data.run.ratios import thrust_error
from benchtool.explain.engine.evidence import EARLY, LATE
from benchtool.explain.recording_checks import repair_readings
from benchtool.fit.uncertainty.bench_errors import Visits
from benchtool.physics.conditions import OUT_OF_GROUND_EFFECT_M, Conditions
from benchtool.physics.model import Model

Mask = NDArray[np.bool_]

MIN_POINTS = 4  # fewer do not identify effects; assumed
SAMPLE_S = 2.0  # averaging time of a point if not recorded; assumed
FIRST_VISITS = 2  # of a level, before its speed can be predicted
CURVE_AT_S = 900.0  # reference time of the curvature of a discharge; assumed


@dataclass(frozen=True, eq=False, kw_only=True)
class SupplyModel:
    """Pulses, speeds and voltage of a sweep's points with running motors, (m,) each.

    Drive is the relative supply voltage times the relative speed near the plate, where blade torque
    differs. Each pulse level has a fitted speed scale, so no map from pulse to speed is needed;
    only changes of speed within a level and of voltage are compared with a model.
    """

    time_s: Array  # since the start of the run
    pulse_us: Array  # mean over rotors
    speed_rad_s: Array  # mean over rotors; standard error: `speed_se`
    speed_se: Array
    rotor_rad_s: Array  # (n, m) of measured rotors; standard error: `rotor_se`
    rotor_se: Array
    load: Array  # over `full_load`; current, or cube of speed if not measured
    full_load: float  # maximum of this sweep or of a reference sweep
    by_current: bool  # load is current
    voltage_V: Array  # nan if not measured; standard error: `voltage_se`
    voltage_se: float

    @cached_property
    def level(self) -> NDArray[np.intp]:
        """Index of the pulse level (m,), with pulses rounded to 0.1 us."""
        indices: NDArray[np.intp] = np.unique(np.round(self.pulse_us, 1), return_inverse=True)[1]
        return indices.reshape(-1)

    @cached_property
    def is_predicted(self) -> Mask:
        """Predicted rows: all but the first visits of a level."""
        is_predicted = np.ones(len(self.level), bool)
        for index in np.unique(self.level):
            is_predicted[np.flatnonzero(self.level == index)[:FIRST_VISITS]] = False
        return is_predicted

    def planned(self, time_s: Array, pulse_us: Array, speed_rad_s: Array) -> SupplyModel:
        """Return the model of a planned sweep with the same measurement errors."""
        rotors = len(self.rotor_rad_s)
        full_load = float(np.max(speed_rad_s) ** 3)
        return replace(
            self,
            time_s=time_s,
            pulse_us=pulse_us,
            speed_rad_s=speed_rad_s,
            speed_se=np.full(len(time_s), float(np.median(self.speed_se))),
            rotor_rad_s=np.tile(speed_rad_s, (rotors, 1)),
            rotor_se=np.full((rotors, len(time_s)), float(np.median(self.rotor_se))),
            load=speed_rad_s**3 / full_load,
            full_load=full_load,
            by_current=False,
            voltage_V=np.full(len(time_s), np.fmax.reduce(self.voltage_V)),
        )

    def loaded_as(self, other: SupplyModel) -> SupplyModel:
        """Return the model with the full load of another sweep, so that one drop fits both."""
        if self.by_current != other.by_current:
            return self
        load = self.load * self.full_load / other.full_load
        return replace(self, load=load, full_load=other.full_load)

    def supply(self, rate_per_s: Array, curve: Array, drop: Array) -> Array:
        """Return supply over its initial open-circuit voltage (m, n_sets), for sets (n_sets,).

        `curve` is the relative increase of the rate at `CURVE_AT_S`, `drop` is at full load.
        """
        time = self.time_s[:, None]
        loss = rate_per_s * time * (1.0 + curve * (time / CURVE_AT_S - 1.0))
        return np.asarray(1.0 - loss - drop * self.load[:, None], float)

    def speeds(self, drive: Array) -> Array:
        """Return speeds (m, n_sets) for relative speeds (n or 1, m, n_sets), scaled by level."""
        mean_drive: Array = drive.mean(axis=0)
        fitted = np.empty_like(mean_drive)
        for level in np.unique(self.level):
            rows = self.level == level
            w = 1.0 / self.speed_se[rows] ** 2
            shape = mean_drive[rows]
            fitted[rows] = ((w * self.speed_rad_s[rows]) @ shape) / (w @ shape**2) * shape
        return fitted

    @property
    def n_rows(self) -> int:
        """Number of speeds and voltages."""
        return len(self.time_s) + int(np.isfinite(self.voltage_V).sum())

    def whiten_changes(self, changes: Array) -> Array:
        """Return changes of speeds and voltages (n_rows, r) divided by their standard errors.

        The fitted scales of levels and the fitted open-circuit voltage are projected out.
        """
        whitened, m = changes.copy(), len(self.time_s)
        for level in np.unique(self.level):
            rows = np.flatnonzero(self.level == level)
            shape = self.speed_rad_s[rows]
            weights = shape / self.speed_se[rows] ** 2
            whitened[rows] -= shape[:, None] * ((weights @ changes[rows]) / (weights @ shape))
        whitened[:m] /= self.speed_se[:, None]
        shape = self.voltage_V[np.isfinite(self.voltage_V)]
        if len(shape):
            whitened[m:] -= shape[:, None] * (shape @ changes[m:]) / (shape @ shape)
            whitened[m:] /= self.voltage_se
        return whitened

    def predicted(self, drive: Array, readings: Array) -> Array:
        """Return predictions of each visit from the earlier ones of its level, else 0.

        `drive` (n or 1, m, n_sets) is the speed over that at full supply out of ground effect,
        `readings` (n, m, n_sets) are speeds of each rotor, or their errors (linear prediction).
        """
        predictions = np.zeros(np.broadcast_shapes(readings.shape, drive.shape))
        weights = 1.0 / self.rotor_se[:, :, None] ** 2
        for level in np.unique(self.level):
            rows = np.flatnonzero(self.level == level)
            shape, weight = drive[:, rows], weights[:, rows]
            weighted_sum = np.cumsum(weight * shape * readings[:, rows], axis=1)
            total_weight = np.cumsum(weight * shape**2, axis=1)
            predictions[:, rows[1:]] = shape[:, 1:] * weighted_sum[:, :-1] / total_weight[:, :-1]
        predictions[:, ~self.is_predicted] = 0.0
        return predictions

    def voltages(self, supply: Array) -> Array:
        """Return voltages (m, n_sets) with fitted open-circuit voltage."""
        has_voltage = np.isfinite(self.voltage_V)
        shape = supply[has_voltage]
        scale = (self.voltage_V[has_voltage] @ shape) / np.sum(shape**2, axis=0)
        return np.asarray(scale * supply, float)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SweepLog:
    """Points of one sweep in the order of time."""

    conditions: Conditions  # of all points (m,), including tares
    thrust_N: Array  # (m,) readings of the load cell
    se_N: Array  # (m,) stated standard error, including that of speeds
    visits: Visits  # groups of points with shared errors
    power: SupplyModel | None  # speeds at pulses; None if either is missing
    name: str  # of the file, for display
    remarks: tuple[str, ...]  # repairs and missing channels

    def __len__(self) -> int:
        return len(self.thrust_N)

    @property
    def tare(self) -> Mask:
        """Mask of tare points (m,): motors at standstill, reading after the tare."""
        return self.visits.tare

    @property
    def stay(self) -> NDArray[np.intp]:
        """Index of the stay at one plate position (m,)."""
        return self.visits.stay

    def bench_numbers(self, rig: Rig) -> dict[str, float]:
        """Return thrust over squared speed far from the plate, and speed over pulse."""
        c, power = self.conditions, self.power
        squared_speed = np.sum(c.speed_rad_s**2, axis=0)
        is_far = ~self.tare & (squared_speed > 0.0)
        is_far &= c.plate_z_m >= np.quantile(c.plate_z_m[is_far], 0.75)
        numbers = {}
        if c.speed_measured:
            ratio = np.median(self.thrust_N[is_far] / squared_speed[is_far])
            numbers["thrust over squared speed"] = float(ratio)
        if power is not None:
            middle = np.argsort(power.pulse_us)[len(power.pulse_us) // 2]
            numbers["speed over pulse"] = float(power.speed_rad_s[middle] / power.pulse_us[middle])
        return numbers


def sweep_log(
    recording: Recording, rig: Rig, name: str = "", zero: ZeroNoise | None = None
) -> SweepLog:
    """Return the sweep of a recording of points; the zero drift is by default the rig's.

    Raises:
        InputError: points without thrust or speed, or too few of them.
    """
    label = name or recording.provenance.get("file", "the recording")
    if "thrust_N" not in recording:
        raise InputError(
            f"{label} has no thrust_N, only {', '.join(recording.names)}; map it in [columns] of "
            f"the model"
        )
    check_rotor_count(recording, rig, label)
    recording, repairs = repair_readings(recording, rig, label)
    if "time_s" in recording:
        recording = recording.select(np.argsort(recording.column("time_s"), kind="stable"))
    kinds = recording.column("kind") if "kind" in recording else np.zeros(len(recording))
    is_tare = kinds == word_to_code("kind", "tare")
    conditions = _neutralize_tares(Conditions.from_recording(recording, rig), is_tare)
    thrust = recording.to_si("thrust_N")
    se, assumptions = _errors(recording, rig)
    is_complete = np.isfinite(thrust) & np.isfinite(se) & (se > 0.0) & conditions.is_complete
    n_points = int((is_complete & ~is_tare).sum())
    if n_points < MIN_POINTS:
        raise InputError(
            f"{label} has {n_points} complete points (thrust, speed and plate); minimum: "
            f"{MIN_POINTS}; sweep more distances or levels"
        )
    power = reconstruct_supply(recording.select(is_complete & ~is_tare), rig)
    complete = conditions.select(is_complete)
    log = SweepLog(
        conditions=complete,
        thrust_N=thrust[is_complete],
        se_N=se[is_complete],
        visits=Visits.of(recording.select(is_complete), complete, rig, zero),
        power=power,
        name=label,
        remarks=(*repairs, *assumptions),
    )
    return replace(log, remarks=(*log.remarks, *_list_missing(log, recording)))


def _neutralize_tares(conditions: Conditions, tare: Mask) -> Conditions:
    """Return conditions with zero speed and no plate at tares."""
    speed = conditions.speed_rad_s.copy()
    speed[:, tare] = 0.0
    coverage = conditions.coverage.copy()
    coverage[:, tare] = 0.0
    return replace(
        conditions,
        speed_rad_s=speed,
        coverage=coverage,
        plate_z_m=np.where(tare, OUT_OF_GROUND_EFFECT_M, conditions.plate_z_m),
        plate_x_m=np.where(tare, 0.0, conditions.plate_x_m),
        plate_tilt_rad=np.where(tare, 0.0, conditions.plate_tilt_rad),
        load_direction=np.where(tare, -1.0, conditions.load_direction),
    )


def _errors(recording: Recording, rig: Rig) -> tuple[Array, list[str]]:
    """Return the standard error of all thrusts (m,), and assumptions for it."""
    if (errors := thrust_error(recording)) is not None:
        return errors[0], []
    sensor = rig.sensors.get("thrust_N", Sensor())
    se_N = sensor.noise / np.sqrt(sensor.rate_Hz * SAMPLE_S)
    se_N = float(np.hypot(se_N, sensor.quantum / np.sqrt(12.0)))
    if not se_N > 0.0:
        raise InputError(
            f"no standard error of thrust in the points and no load cell noise in rig "
            f"{rig.name!r}; add thrust_se_N to the points, or sensors.thrust_N to the rig"
        )
    assumed = "no standard errors of thrust: load cell noise of the rig is used"
    return np.full(len(recording), se_N), [assumed]


def _list_missing(log: SweepLog, recording: Recording) -> list[str]:
    """Return warnings on missing data of a sweep and their consequences."""
    notes, tare = [], log.tare
    if dropped := len(recording) - len(log):
        n_rows = pluralize(len(recording), "row")
        notes.append(f"dropped for missing values: {dropped} of {n_rows}")
    if not tare.any():
        notes.append("no rows of kind 'tare': zero errors are judged from thrust alone")
    if "time_s" not in recording:
        notes.append("no time_s: drift, hysteresis and battery sag cannot be judged")
    elif not (log.conditions.load_direction[~tare] < 0.0).any():
        notes.append("levels were approached only from below: hysteresis looks like a tare offset")
    if not log.conditions.speed_measured:
        notes.append("no rpm: effects between pulse and speed are judged from thrust alone")
    elif log.power is None:
        notes.append("no pulses with speeds: battery sag cannot be judged")
    return notes


def reconstruct_supply(recording: Recording, rig: Rig) -> SupplyModel | None:
    """Return the supply model; None if pulses, speeds or time are missing."""
    n = rig.n_rotors
    speeds, errors = _rows(recording, "rpm{}", n), _rows(recording, "rpm{}_se", n)
    pulses = _rows(recording, "pwm{}_us", n)
    if not len(speeds) or not len(pulses) or "time_s" not in recording:
        return None
    speed, time_s = speeds.mean(axis=0), recording.to_si("time_s")
    if not np.isfinite(speed).all() or not np.isfinite(pulses).all():
        return None
    mean_se = np.sqrt(np.sum(errors**2, axis=0)) / n if len(errors) else np.zeros(len(time_s))
    sensor = rig.sensors.get("rpm", Sensor())
    min_se = np.pi / 30.0 * max(sensor.quantum / np.sqrt(12.0), 0.01)
    rotor_se = errors if errors.shape == speeds.shape else np.zeros_like(speeds)
    voltage = _column(recording, "voltage_V")
    current = _column(recording, "current_A")
    by_current = bool(np.isfinite(current).all() and np.ptp(current) > 0.0)
    load = current if by_current else speed**3
    voltmeter = rig.sensors.get("voltage_V", Sensor())
    samples = np.nanmedian(recording.column("n_samples")) if "n_samples" in recording else 1.0
    voltage_se = np.hypot(voltmeter.noise / np.sqrt(samples), voltmeter.quantum / np.sqrt(12.0))
    power = SupplyModel(
        time_s=time_s,
        pulse_us=pulses.mean(axis=0),
        speed_rad_s=speed,
        speed_se=np.hypot(np.nan_to_num(mean_se), min_se / np.sqrt(n)),
        rotor_rad_s=speeds,
        rotor_se=np.hypot(np.nan_to_num(rotor_se), min_se),
        load=load / load.max(),
        full_load=float(load.max()),
        by_current=by_current,
        voltage_V=voltage,
        voltage_se=float(max(voltage_se, 1e-3)),
    )
    return power if power.is_predicted.any() else None


def _rows(recording: Recording, pattern: str, n: int) -> Array:
    """Return a channel of all rotors (n, m), else of the first one (1, m), else (0,)."""
    names = [pattern.format(i + 1) for i in range(n)]
    if any(name not in recording for name in names):
        names = [name for name in names[:1] if name in recording]
    return np.array([recording.to_si(name) for name in names])


def _column(recording: Recording, name: str) -> Array:
    return recording.to_si(name) if name in recording else np.full(len(recording), np.nan)


NEAR_Z_OVER_R, FAR_Z_OVER_R = 1.0, 4.0  # limits of regimes; assumed


def sweep_regimes(log: SweepLog, model: Model) -> dict[str, Mask]:
    """Return masks (m,) of regimes by their names in reports."""
    conditions = log.conditions
    is_running = ~log.tare
    ratio = conditions.plate_z_m / model.rig.propulsion.radius_m
    squared_speed = np.sum(conditions.speed_rad_s**2, axis=0)
    is_partial = (conditions.coverage > 0.0) & (conditions.coverage < 0.999)
    covered = (conditions.coverage > 0.0).any(axis=0)
    at_edge = is_running & (is_partial.any(axis=0) | ~covered)
    is_over = is_running & ~at_edge
    is_near, is_far = ratio < NEAR_Z_OVER_R, ratio >= FAR_Z_OVER_R
    regimes = {
        f"z/R below {NEAR_Z_OVER_R:g}": is_over & is_near,
        f"z/R {NEAR_Z_OVER_R:g} to {FAR_Z_OVER_R:g}": is_over & ~is_near & ~is_far,
        "plate far away": is_running & is_far,
        "plate aside": is_over & (np.abs(conditions.plate_x_m) > 1e-3),
        "rotors at the plate's edge": at_edge,
        "after a tare, nothing turning": log.tare,
    }
    low, high = np.quantile(squared_speed[is_running], [1.0 / 3.0, 2.0 / 3.0])
    if high > 1.05 * low:
        regimes["high throttle"] = is_running & (squared_speed >= high)
        regimes["low throttle"] = is_running & (squared_speed <= low)
    if np.ptp(conditions.time_s) > 0.0:
        thirds_s = np.quantile(conditions.time_s, [1.0 / 3.0, 2.0 / 3.0])
        regimes[LATE] = is_running & (conditions.time_s > thirds_s[1])
        regimes[EARLY] = is_running & (conditions.time_s < thirds_s[0])
    if np.ptp(conditions.elapsed_s[is_running]) > 0.0:
        long_s = np.quantile(conditions.elapsed_s[is_running], 2.0 / 3.0)
        regimes["long after a tare"] = is_running & (conditions.elapsed_s > long_s)
    if (conditions.load_direction[is_running] < 0.0).any():
        regimes["levels on the way up"] = is_running & (conditions.load_direction > 0.0)
        regimes["levels on the way down"] = is_running & (conditions.load_direction < 0.0)
    n = len(log)
    return {name: mask for name, mask in regimes.items() if 0.0 < mask.sum() < 0.95 * n}
