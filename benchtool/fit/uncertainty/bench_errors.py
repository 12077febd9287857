"""Shared errors of the points of a sweep: plate position, scales and zero drift.

Each is an `ErrorSource` of thrusts: the change of every point for one standard deviation, at the
model's values. Fits and explanations use the same sources.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.error_source import ErrorSource
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig, Sensor
from benchtool.core.units import Array
from benchtool.data.calibration import ZeroNoise, zero_covariance, zero_noise
from benchtool.data.columns import word_to_code
from benchtool.fit.problem import NOISE_PLACE
from benchtool.physics.conditions import MIN_MOVE, Conditions
from benchtool.physics.model import Model

Mask = NDArray[np.bool_]

MIN_EFFECT = 1e-9  # columns below this share of the largest thrust are rounding and dropped
ON_GRID = 1e-3  # tolerance for equal reading and stage position, in sensor quanta; assumed
# Eigenvalues of the zero's covariance below this share of the largest are dropped: some 1 % of the
# variance of a random walk, between neighbouring points.
MIN_SHARE = 5e-4


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Visits:
    """Grouping of points by plate position and tare, for shared errors."""

    stay: NDArray[np.intp]  # (n,) number of the stay at one plate position
    zero_s: Array  # (n,) time since the last tare, or since the first point without any tare
    tared: NDArray[np.intp]  # (n,) number of that tare
    tare: Mask  # (n,) True for a tare point: standstill, residual zero
    rounded: Mask  # (n,) True if the distance is not on the sensor's grid, so that it is rounded
    one_sided: bool  # all positions were approached from one side, so that backlash is no scatter
    calibrated: bool  # thrust has a calibration, whose scale error is a separate source
    zero: ZeroNoise

    @classmethod
    def of(
        cls, points: Recording, conditions: Conditions, rig: Rig, zero: ZeroNoise | None = None
    ) -> Visits:
        """Return the grouping of the points of one run or table; `zero` is by default the rig's."""
        kinds = points.column("kind") if "kind" in points else np.zeros(len(points))
        tare = kinds == word_to_code("kind", "tare")
        elapsed_s = conditions.elapsed_s
        if "elapsed_s" not in points:
            elapsed_s = conditions.time_s - np.nanmin(conditions.time_s)
        tare_time_s = np.round(np.nan_to_num(conditions.time_s - elapsed_s))
        read_m, stage_m = (
            points.to_si(name) if name in points else np.full(len(points), np.nan)
            for name in ("plate_read_z_m", "plate_stage_z_m")
        )
        grid_m = ON_GRID * rig.sensors.get("plate_z_m", Sensor()).quantum
        return cls(
            stay=plate_positions(conditions, tare, ordered="time_s" in points),
            zero_s=np.nan_to_num(elapsed_s),
            tared=np.unique(tare_time_s, return_inverse=True)[1].reshape(-1).astype(np.intp),
            tare=tare,
            rounded=~(np.abs(read_m - stage_m) <= grid_m),
            one_sided=points.provenance.get("approach", "") == "one side",
            calibrated=bool(points.provenance.get("calibration", "")),
            zero=zero or zero_noise(rig),
        )


def concatenate_visits(parts: list[Visits]) -> Visits:
    """Return the grouping of the points of several runs as one."""

    def renumber(name: str) -> NDArray[np.intp]:
        rows = [getattr(part, name) for part in parts]
        first = np.cumsum([0, *(int(row.max(initial=-1)) + 1 for row in rows[:-1])])
        return np.concatenate([row + shift for row, shift in zip(rows, first, strict=True)])

    return Visits(
        stay=renumber("stay"),
        zero_s=np.concatenate([part.zero_s for part in parts]),
        tared=renumber("tared"),
        tare=np.concatenate([part.tare for part in parts]),
        rounded=np.concatenate([part.rounded for part in parts]),
        one_sided=all(part.one_sided for part in parts),
        calibrated=any(part.calibrated for part in parts),
        zero=max((part.zero for part in parts), key=lambda zero: zero.walk),
    )


def plate_positions(conditions: Conditions, tare: Mask, *, ordered: bool) -> NDArray[np.intp]:
    """Return the number of the stay of each row (m,): consecutive rows at one plate position.

    Rows of unknown order are grouped by position.
    """
    position = np.array([conditions.plate_z_m, conditions.plate_x_m, conditions.plate_tilt_rad])
    if not ordered:
        grid_positions = np.round(position / MIN_MOVE)
        return np.unique(grid_positions, axis=1, return_inverse=True)[1].reshape(-1).astype(np.intp)
    is_new = np.any(np.abs(np.diff(position, axis=1)) > MIN_MOVE, axis=0)
    is_new |= tare[1:] != tare[:-1]
    return np.concatenate([[0], np.cumsum(is_new)]).astype(np.intp)


def place_sd_m(model: Model, *, one_sided: bool) -> float:
    """Return the standard uncertainty of the plate position at a stay.

    A value that the user sets or frees overrides the rig's one-sided value.
    """
    parameter, rig = model.parameters[NOISE_PLACE], model.rig
    if one_sided and not parameter.free and parameter.value == rig.position_sd_m():
        return rig.position_sd_m(one_sided=True)
    return parameter.value


def bench_errors(model: Model, conditions: Conditions, visits: Visits) -> tuple[ErrorSource, ...]:
    """Return the error sources of thrusts (m,) in N, at the model's values.

    Errors of sensors and stage are from the model's rig. Conditions of a tare have speed 0.
    """
    thrust = _thrust(model, conditions)
    turning = ~visits.tare
    sensors = model.rig.sensors
    z, rpm, cell = (sensors.get(name, Sensor()) for name in ("plate_z_m", "rpm", "thrust_N"))
    place_m, read_m = place_sd_m(model, one_sided=visits.one_sided), z.quantum / 12.0**0.5
    gain, arm = 0.0 if visits.calibrated else cell.scale_sd, model.rig.body.arm_sd
    scaled_arms = replace(model, rig=_with_arms(model.rig, 1.0 + arm)) if arm else model
    grid_index = np.round(conditions.plate_z_m / (z.quantum or MIN_MOVE))
    move_plate = conditions.with_plate_offset

    def change(moved: Conditions, model_used: Model = model) -> Array:
        return np.where(turning, _thrust(model_used, moved) - thrust, 0.0)

    def scale_effect(field: str, sd: float) -> Array:
        moved = replace(conditions, **{field: getattr(conditions, field) * (1.0 + sd)})
        return change(moved)[:, None]

    reading_effect = visits.rounded * change(move_plate(read_m))
    sources = [
        _zero_drift(visits, model.rig),
        _type_b("place", "m", place_m, _by_group(change(move_plate(place_m)), visits.stay)),
        _type_b("plate reading", "m", read_m, _by_group(reading_effect, grid_index)),
        _type_b("distance scale", "1", z.scale_sd, scale_effect("plate_z_m", z.scale_sd)),
        _type_b("rpm scale", "1", rpm.scale_sd, scale_effect("speed_rad_s", rpm.scale_sd)),
        _type_b("arm", "1", arm, change(conditions, scaled_arms)[:, None]),
        _type_b("thrust scale", "1", gain, gain * thrust[:, None]),
    ]
    min_effect = MIN_EFFECT * np.abs(thrust).max()
    return tuple(
        replace(
            source,
            columns=source.columns[:, np.abs(source.columns).max(axis=0) > min_effect],
            origin=source.origin or _origin(model.rig, source.name),
        )
        for source in sources
        if np.abs(source.columns).max(initial=0.0) > min_effect
    )


def _type_b(name: str, unit: str, sd: float, columns: Array) -> ErrorSource:
    return ErrorSource(
        name=name,
        kind="B",
        unit=unit,
        sd=sd,
        columns=columns,
        distribution="uniform" if name == "plate reading" else "normal",
        parameter=NOISE_PLACE if name == "place" else "",
    )


STATED_BY: dict[str, tuple[str, ...]] = {  # rig keys of a source
    "place": ("plate.repeatability_m", "plate.backlash_m"),
    "plate reading": ("sensors.plate_z_m.quantum",),
    "distance scale": ("sensors.plate_z_m.scale_sd",),
    "rpm scale": ("sensors.rpm.scale_sd",),
    "arm": ("body.arm_sd",),
    "thrust scale": ("sensors.thrust_N.scale_sd",),
    "zero wander": ("sensors.thrust_N.walk", "sensors.thrust_N.flicker"),
}


def _origin(rig: Rig, name: str) -> str:
    origins = (rig.sources[key] for key in STATED_BY[name] if rig.sources.get(key))
    return next(origins, f"rig {rig.name}")


def _zero_drift(visits: Visits, rig: Rig) -> ErrorSource:
    """Return the zero drift since the tare: a root of its covariance over all points."""
    parts = []
    for number in np.unique(visits.tared):
        rows = np.flatnonzero(visits.tared == number)
        size, axes = np.linalg.eigh(zero_covariance(visits.zero_s[rows], visits.zero))
        significant = size > MIN_SHARE * max(float(size[-1]), 0.0)
        columns_of_tare = np.zeros((len(visits.tared), int(significant.sum())))
        columns_of_tare[rows] = axes[:, significant] * np.sqrt(size[significant])
        parts.append(columns_of_tare)
    columns = np.concatenate(parts, axis=1)
    is_estimated = np.isfinite(visits.zero.dof)
    return ErrorSource(
        name="zero wander",
        kind="A" if is_estimated else "B",
        unit="N",
        sd=float(np.sqrt(np.mean(np.sum(columns**2, axis=1)))),
        columns=columns,
        dof=visits.zero.dof,
        origin="the zero while the rotors stood still" if is_estimated else "",
    )


def _thrust(model: Model, conditions: Conditions) -> Array:
    predicted = np.asarray(model.thrust_N(conditions), float)
    # Points with unknown conditions are excluded by the fit.
    thrust: Array = np.nan_to_num(np.broadcast_to(predicted, (len(conditions),)))
    return thrust


def _by_group(change: Array, group: Array | NDArray[np.intp]) -> Array:
    """Return one column of changes (m,) for each group (m, r)."""
    return np.where(group[:, None] == np.unique(group), change[:, None], 0.0)


def _with_arms(rig: Rig, factor: float) -> Rig:
    rotors = (
        replace(rotor, x_m=rotor.x_m * factor, y_m=rotor.y_m * factor) for rotor in rig.rotors
    )
    half = rig.body.half_diagonal_m
    body = rig.body if half is None else replace(rig.body, half_diagonal_m=half * factor)
    return replace(rig, rotors=tuple(rotors), body=body)
