"""From a recording of points to a sweep that can be held against a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.core.plural import pluralize
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig, Sensor
from benchtool.core.rotor_count import check_rotor_count
from benchtool.data.columns import word_to_code
from benchtool.data.run.ratios import thrust_error
from benchtool.explain.engine.evidence import EARLY, LATE
from benchtool.explain.recording_checks import check_bench_kind, repair_readings
from benchtool.explain.sweep.power import SupplyModel, reconstruct_supply
from benchtool.fit.uncertainty.bench_errors import Visits
from benchtool.physics.conditions import OUT_OF_GROUND_EFFECT_M, Conditions
from benchtool.physics.model import Model

Mask = NDArray[np.bool_]

MIN_POINTS = 4  # below this many points a sweep says next to nothing; assumed
SAMPLE_S = 2.0  # length of a point's samples where a table does not say how many there were


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class SweepLog:
    """Hold the points of one sweep in the order of time."""

    conditions: Conditions  # of every point (m,), tares among them
    thrust_N: Array  # (m,) what the load cell showed
    se_N: Array  # (m,) its stated standard error, that of speeds taken into it
    visits: Visits  # what its points have in common
    power: SupplyModel | None  # pulses against speeds, where both are known
    name: str  # of the file, for people
    remarks: tuple[str, ...]  # what was repaired, and what the sweep lacks

    def __len__(self) -> int:
        return len(self.thrust_N)

    @property
    def tare(self) -> Mask:
        """Whether nothing turns and the reading is what a tare left (m,)."""
        return self.visits.tare

    @property
    def stay(self) -> NDArray[np.intp]:
        """Number of the stay at one place of the plate (m,)."""
        return self.visits.stay


def sweep_log(recording: Recording, rig: Rig, name: str = "") -> SweepLog:
    """Return the sweep of a recording of points.

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
    recording, mended = repair_readings(recording, rig, label)
    if "time_s" in recording:
        recording = recording.select(np.argsort(recording.column("time_s"), kind="stable"))
    conditions = Conditions.from_recording(recording, rig)
    kinds = recording.column("kind") if "kind" in recording else np.zeros(len(recording))
    tare = kinds == word_to_code("kind", "tare")
    conditions = _with_still_rows(conditions, tare)
    thrust = recording.to_si("thrust_N")
    se, assumed = _errors(recording, rig)
    whole = np.isfinite(thrust) & np.isfinite(se) & (se > 0.0) & conditions.known
    points = int((whole & ~tare).sum())
    if points < MIN_POINTS:
        raise InputError(
            f"{label} has {points} whole points (thrust, speed and plate known), and at least "
            f"{MIN_POINTS} are needed; sweep more distances or levels"
        )
    power = reconstruct_supply(recording.select(whole & ~tare), rig)
    whole_rows = conditions.select(whole)
    return SweepLog(
        conditions=whole_rows,
        thrust_N=thrust[whole],
        se_N=se[whole],
        visits=Visits.of(recording.select(whole), whole_rows, rig),
        power=power,
        name=label,
        remarks=(
            *mended,
            *assumed,
            *_lacks(recording, whole_rows, tare[whole], power, int((~whole).sum())),
        ),
    )


def _with_still_rows(conditions: Conditions, tare: Mask) -> Conditions:
    """Return conditions whose tares have speeds of 0 and no plate: nothing of it shows."""
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
    """Return the standard error of every thrust (m,), and what had to be assumed for it."""
    if (found := thrust_error(recording)) is not None:
        return found[0], []
    sensor = rig.sensors.get("thrust_N", Sensor())
    stated = sensor.noise / np.sqrt(sensor.rate_Hz * SAMPLE_S)
    stated = float(np.hypot(stated, sensor.quantum / np.sqrt(12.0)))
    if not stated > 0.0:
        raise InputError(
            "the points state no standard error of thrust, and rig "
            f"{rig.name!r} no noise of its load cell; give thrust_se_N, or sensors.thrust_N"
        )
    assumed = "no standard errors of thrust: taken from the rig's load cell"
    return np.full(len(recording), stated), [assumed]


def _lacks(
    recording: Recording,
    whole_rows: Conditions,
    tare: Mask,
    power: SupplyModel | None,
    dropped: int,
) -> list[str]:
    """Return what a sweep lacks, with what that costs."""
    out = []
    if dropped:
        out.append(
            f"left out for an empty cell: {dropped} of {pluralize(dropped + len(tare), 'row')}"
        )
    if not tare.any():
        out.append("no rows of kind 'tare': what stands on the zero shows in thrust alone")
    if "time_s" not in recording:
        out.append("no time_s: drift, hysteresis and battery sag cannot be judged")
    elif not (whole_rows.load_direction[~tare] < 0.0).any():
        out.append("levels were only ever visited upward: hysteresis looks like a tare offset")
    if not whole_rows.speed_measured:
        out.append("no rpm: what is between pulse and speed shows in thrust alone")
    elif power is None:
        out.append("no pulses beside the speeds: battery sag cannot be judged")
    return out


def refuse_other_sweeps(logs: Sequence[SweepLog]) -> None:
    """Refuse sweeps of different benches: by thrust over squared speed, and speed at a pulse."""
    check_bench_kind([(log.name, _bench_numbers(log)) for log in logs])


def _bench_numbers(log: SweepLog) -> dict[str, float]:
    squares = np.sum(log.conditions.speed_rad_s**2, axis=0)
    far = ~log.tare & (squares > 0.0)
    far &= log.conditions.plate_z_m >= np.quantile(log.conditions.plate_z_m[far], 0.75)
    out = {}
    if log.conditions.speed_measured:
        out["thrust over squared speed"] = float(np.median(log.thrust_N[far] / squares[far]))
    if log.power is not None:
        middle = np.argsort(log.power.pulse_us)[len(log.power.pulse_us) // 2]
        out["speed over pulse"] = float(log.power.speed_rad_s[middle] / log.power.pulse_us[middle])
    return out


NEAR_Z_OVER_R, FAR_Z_OVER_R = 1.0, 4.0  # near below, far beyond; assumed


def sweep_regimes(log: SweepLog, model: Model) -> dict[str, Mask]:
    """Return masks (m,) by the words that a report uses."""
    conditions = log.conditions
    running = ~log.tare
    ratio = conditions.plate_z_m / model.rig.propulsion.radius_m
    squares = np.sum(conditions.speed_rad_s**2, axis=0)
    partly = (conditions.coverage > 0.0) & (conditions.coverage < 0.999)
    covered = (conditions.coverage > 0.0).any(axis=0)
    edge = running & (partly.any(axis=0) | ~covered)
    over = running & ~edge
    out = {
        f"z/R below {NEAR_Z_OVER_R:g}": over & (ratio < NEAR_Z_OVER_R),
        f"z/R {NEAR_Z_OVER_R:g} to {FAR_Z_OVER_R:g}": over
        & (ratio >= NEAR_Z_OVER_R)
        & (ratio < FAR_Z_OVER_R),
        "plate far away": running & (ratio >= FAR_Z_OVER_R),
        "plate aside": over & (np.abs(conditions.plate_x_m) > 1e-3),
        "rotors at the plate's edge": edge,
        "after a tare, nothing turning": log.tare,
    }
    low, high = np.quantile(squares[running], [1.0 / 3.0, 2.0 / 3.0])
    if high > 1.05 * low:
        out |= {
            "high throttle": running & (squares >= high),
            "low throttle": running & (squares <= low),
        }
    if np.ptp(conditions.time_s) > 0.0:
        late = np.quantile(conditions.time_s, [1.0 / 3.0, 2.0 / 3.0])
        out |= {
            LATE: running & (conditions.time_s > late[1]),
            EARLY: running & (conditions.time_s < late[0]),
        }
    if np.ptp(conditions.elapsed_s[running]) > 0.0:
        long = np.quantile(conditions.elapsed_s[running], 2.0 / 3.0)
        out["long after a tare"] = running & (conditions.elapsed_s > long)
    if (conditions.load_direction[running] < 0.0).any():
        out |= {
            "levels on the way up": running & (conditions.load_direction > 0.0),
            "levels on the way down": running & (conditions.load_direction < 0.0),
        }
    n = len(log)
    return {name: mask for name, mask in out.items() if 0.0 < mask.sum() < 0.95 * n}
