"""Sweep log of a recording of points, prepared for comparison with a model."""

from __future__ import annotations

from dataclasses import dataclass, replace

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
from benchtool.explain.sweep.power import SupplyModel, reconstruct_supply
from benchtool.fit.uncertainty.bench_errors import Visits
from benchtool.physics.conditions import OUT_OF_GROUND_EFFECT_M, Conditions
from benchtool.physics.model import Model

Mask = NDArray[np.bool_]

MIN_POINTS = 4  # fewer do not identify effects; assumed
SAMPLE_S = 2.0  # averaging time of a point if not recorded; assumed


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
    conditions = Conditions.from_recording(recording, rig)
    kinds = recording.column("kind") if "kind" in recording else np.zeros(len(recording))
    is_tare = kinds == word_to_code("kind", "tare")
    conditions = _neutralize_tares(conditions, is_tare)
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
    return SweepLog(
        conditions=complete,
        thrust_N=thrust[is_complete],
        se_N=se[is_complete],
        visits=Visits.of(recording.select(is_complete), complete, rig, zero),
        power=power,
        name=label,
        remarks=(
            *repairs,
            *assumptions,
            *_list_missing(
                recording, complete, is_tare[is_complete], power, int((~is_complete).sum())
            ),
        ),
    )


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


def _list_missing(
    recording: Recording, complete: Conditions, tare: Mask, power: SupplyModel | None, dropped: int
) -> list[str]:
    """Return warnings on missing data of a sweep and their consequences."""
    notes = []
    if dropped:
        n_rows = pluralize(dropped + len(tare), "row")
        notes.append(f"dropped for missing values: {dropped} of {n_rows}")
    if not tare.any():
        notes.append("no rows of kind 'tare': zero errors are judged from thrust alone")
    if "time_s" not in recording:
        notes.append("no time_s: drift, hysteresis and battery sag cannot be judged")
    elif not (complete.load_direction[~tare] < 0.0).any():
        notes.append("levels were approached only from below: hysteresis looks like a tare offset")
    if not complete.speed_measured:
        notes.append("no rpm: effects between pulse and speed are judged from thrust alone")
    elif power is None:
        notes.append("no pulses with speeds: battery sag cannot be judged")
    return notes


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
    regimes = {
        f"z/R below {NEAR_Z_OVER_R:g}": is_over & (ratio < NEAR_Z_OVER_R),
        f"z/R {NEAR_Z_OVER_R:g} to {FAR_Z_OVER_R:g}": is_over
        & (ratio >= NEAR_Z_OVER_R)
        & (ratio < FAR_Z_OVER_R),
        "plate far away": is_running & (ratio >= FAR_Z_OVER_R),
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
