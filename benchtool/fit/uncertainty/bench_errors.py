"""Errors that the points of a sweep share: place, scales and the wander of the zero.

Each becomes an `ErrorSource` of thrusts: how every point would move with one standard deviation of
it, at a model's present values. Fits and explanations take the same ones.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.error_source import ErrorSource
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig, Sensor
from benchtool.data.columns import word_to_code
from benchtool.data.run.zero_noise import ZeroNoise, zero_covariance, zero_noise
from benchtool.fit.problem import NOISE_PLACE
from benchtool.physics.conditions import SAME_PLACE, Conditions
from benchtool.physics.model import Model

Mask = NDArray[np.bool_]

SHOWS = 1e-9  # columns below this share of the greatest thrust are rounding and left out
ON_GRID = 1e-3  # steps between a reading and the distance of the stage that are none; assumed
# Directions of the zero's covariance below this share of its largest are left out: of a random
# walk some 1 % of its variance, which goes from one point to the next.
MIN_SHARE = 5e-4


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Visits:
    """Say what the points of sweeps have in common.

    Attributes:
        stay: (n,) number of the stay at one place of the plate.
        zero_s: (n,) time since the zero was last known: a tare, or the first point without any.
        tared: (n,) number of that tare.
        tare: (n,) whether nothing turns and the reading is what a tare left.
        rounded: (n,) whether rounding moves the distance that is read: not on the sensor's grid.
        one_sided: whether every place was approached from one side, so that play is no scatter.
        calibrated: whether thrust went through a calibration, whose scale counts by itself.
    """

    stay: NDArray[np.intp]
    zero_s: Array
    tared: NDArray[np.intp]
    tare: Mask
    rounded: Mask
    one_sided: bool
    calibrated: bool
    zero: ZeroNoise

    @classmethod
    def of(cls, points: Recording, conditions: Conditions, rig: Rig) -> Visits:
        """Return what one run's points, or one table's, have in common."""
        kinds = points.column("kind") if "kind" in points else np.zeros(len(points))
        tare = kinds == word_to_code("kind", "tare")
        since = conditions.elapsed_s
        if "elapsed_s" not in points:
            since = conditions.time_s - np.nanmin(conditions.time_s)
        began = np.round(np.nan_to_num(conditions.time_s - since))
        read_m, stage_m = (
            points.to_si(name) if name in points else np.full(len(points), np.nan)
            for name in ("plate_read_z_m", "plate_stage_z_m")
        )
        near_m = ON_GRID * rig.sensors.get("plate_z_m", Sensor()).quantum
        return cls(
            stay=plate_positions(conditions, tare, ordered="time_s" in points),
            zero_s=np.nan_to_num(since),
            tared=np.unique(began, return_inverse=True)[1].reshape(-1).astype(np.intp),
            tare=tare,
            rounded=~(np.abs(read_m - stage_m) <= near_m),
            one_sided=points.provenance.get("approach", "") == "one side",
            calibrated=bool(points.provenance.get("calibration", "")),
            zero=zero_noise(points, rig),
        )

    def select(self, rows: Mask | NDArray[np.intp]) -> Visits:
        """Return those of only some points."""
        names = ("stay", "zero_s", "tared", "tare", "rounded")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


def joined_visits(parts: list[Visits]) -> Visits:
    """Return what the points of several runs, one after the other, have in common."""

    def numbered(name: str) -> NDArray[np.intp]:
        rows = [getattr(part, name) for part in parts]
        first = np.cumsum([0, *(int(row.max(initial=-1)) + 1 for row in rows[:-1])])
        return np.concatenate([row + shift for row, shift in zip(rows, first, strict=True)])

    return Visits(
        stay=numbered("stay"),
        zero_s=np.concatenate([part.zero_s for part in parts]),
        tared=numbered("tared"),
        tare=np.concatenate([part.tare for part in parts]),
        rounded=np.concatenate([part.rounded for part in parts]),
        one_sided=all(part.one_sided for part in parts),
        calibrated=any(part.calibrated for part in parts),
        zero=max((part.zero for part in parts), key=lambda zero: zero.walk),
    )


def plate_positions(conditions: Conditions, tare: Mask, *, ordered: bool) -> NDArray[np.intp]:
    """Return the number of the stay of each row (m,): rows at one place without a break.

    Rows whose order nobody knows belong together by place.
    """
    place = np.array([conditions.plate_z_m, conditions.plate_x_m, conditions.plate_tilt_rad])
    if not ordered:
        places = np.round(place / SAME_PLACE)
        return np.unique(places, axis=1, return_inverse=True)[1].reshape(-1).astype(np.intp)
    moved = np.any(np.abs(np.diff(place, axis=1)) > SAME_PLACE, axis=0)
    moved |= tare[1:] != tare[:-1]
    return np.concatenate([[0], np.cumsum(moved)]).astype(np.intp)


def place_sd_m(model: Model, *, one_sided: bool) -> float:
    """Return how far the plate may stand from where it is read at a stay, one standard deviation.

    What a user states or frees goes before the rig's number, which knows no side.
    """
    item, rig = model.parameters[NOISE_PLACE], model.rig
    if one_sided and not item.free and item.value == rig.place_sd_m():
        return rig.place_sd_m(one_sided=True)
    return item.value


def bench_errors(model: Model, conditions: Conditions, visits: Visits) -> tuple[ErrorSource, ...]:
    """Return the error sources of thrusts (m,) in N, at a model's present values.

    Args:
        model: on the rig whose sensors and stage state their errors.
        conditions: of m points; a tare's have no speed.
    """
    thrust = _thrust(model, conditions)
    turning = ~visits.tare
    sensors = model.rig.sensors
    z, rpm, cell = (sensors.get(name, Sensor()) for name in ("plate_z_m", "rpm", "thrust_N"))
    place_m, read_m = place_sd_m(model, one_sided=visits.one_sided), z.quantum / 12.0**0.5
    gain, arm = 0.0 if visits.calibrated else cell.scale_sd, model.rig.body.arm_sd
    longer = replace(model, rig=_with_arms(model.rig, 1.0 + arm)) if arm else model
    shown = np.round(conditions.plate_z_m / (z.quantum or SAME_PLACE))
    farther = conditions.moved_by

    def change(moved: Conditions, by: Model = model) -> Array:
        return np.where(turning, _thrust(by, moved) - thrust, 0.0)

    def scaled(field: str, sd: float) -> Array:
        moved = replace(conditions, **{field: getattr(conditions, field) * (1.0 + sd)})
        return change(moved)[:, None]

    misread = visits.rounded * change(farther(read_m))
    found = [
        _wander(visits, model.rig),
        _type_b("place", "m", place_m, _by_group(change(farther(place_m)), visits.stay)),
        _type_b("plate reading", "m", read_m, _by_group(misread, shown)),
        _type_b("distance scale", "1", z.scale_sd, scaled("plate_z_m", z.scale_sd)),
        _type_b("rpm scale", "1", rpm.scale_sd, scaled("speed_rad_s", rpm.scale_sd)),
        _type_b("arm", "1", arm, change(conditions, longer)[:, None]),
        _type_b("thrust scale", "1", gain, gain * thrust[:, None]),
    ]
    least = SHOWS * np.abs(thrust).max()
    return tuple(
        replace(
            source,
            columns=source.columns[:, np.abs(source.columns).max(axis=0) > least],
            origin=source.origin or _origin(model.rig, source.name),
        )
        for source in found
        if np.abs(source.columns).max(initial=0.0) > least
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


STATED_BY: dict[str, tuple[str, ...]] = {  # keys of the rig that state a source
    "place": ("plate.repeatability_m", "plate.backlash_m"),
    "plate reading": ("sensors.plate_z_m.quantum",),
    "distance scale": ("sensors.plate_z_m.scale_sd",),
    "rpm scale": ("sensors.rpm.scale_sd",),
    "arm": ("body.arm_sd",),
    "thrust scale": ("sensors.thrust_N.scale_sd",),
    "zero wander": ("sensors.thrust_N.walk", "sensors.thrust_N.flicker"),
}


def _origin(rig: Rig, name: str) -> str:
    found = (rig.sources[key] for key in STATED_BY[name] if rig.sources.get(key))
    return next(found, f"rig {rig.name}")


def _wander(visits: Visits, rig: Rig) -> ErrorSource:
    """Return the zero's wander: a root of its covariance at every point since its tare."""
    parts = []
    for number in np.unique(visits.tared):
        rows = np.flatnonzero(visits.tared == number)
        size, axes = np.linalg.eigh(zero_covariance(visits.zero_s[rows], visits.zero))
        kept = size > MIN_SHARE * max(float(size[-1]), 0.0)
        part = np.zeros((len(visits.tared), int(kept.sum())))
        part[rows] = axes[:, kept] * np.sqrt(size[kept])
        parts.append(part)
    columns = np.concatenate(parts, axis=1)
    shown = np.isfinite(visits.zero.dof)
    return ErrorSource(
        name="zero wander",
        kind="A" if shown else "B",
        unit="N",
        sd=float(np.sqrt(np.mean(np.sum(columns**2, axis=1)))),
        columns=columns,
        dof=visits.zero.dof,
        origin="the zero while the rotors stood still" if shown else "",
    )


def _thrust(model: Model, conditions: Conditions) -> Array:
    shown = np.asarray(model.thrust_N(conditions), float)
    # What is not known of a point is for a fit to leave out.
    out: Array = np.nan_to_num(np.broadcast_to(shown, (len(conditions),)))
    return out


def _by_group(change: Array, group: Array | NDArray[np.intp]) -> Array:
    """Return one column of changes (m,) for each group (m, r)."""
    return np.where(group[:, None] == np.unique(group), change[:, None], 0.0)


def _with_arms(rig: Rig, factor: float) -> Rig:
    places = (
        replace(place, x_m=place.x_m * factor, y_m=place.y_m * factor) for place in rig.rotors
    )
    half = rig.body.half_diagonal_m
    body = rig.body if half is None else replace(rig.body, half_diagonal_m=half * factor)
    return replace(rig, rotors=tuple(places), body=body)
