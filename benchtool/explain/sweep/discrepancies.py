"""How sweeps may depart from every law: smooth functions of distance, speed, time and place.

Each is a Gaussian process over what it depends on, as large as its tolerance says, and stands as
the columns of a root of its covariance. What depends on the plate or on speed is one function for
all sweeps of a bench; what depends on time or on the visit is another one in each.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.explain.engine.evidence import Discrepancy
from benchtool.explain.engine.smooth import smooth_root
from benchtool.explain.sweep.log import SweepLog
from benchtool.physics.model import Model

WITHIN = 1.0 / 3.0  # standard deviation over tolerance, as that of effects within theirs
NEAR = 3.0  # distance over radius at which half of a departure by the plate is left; assumed

DISTANCE, FASTER, TIME, ASIDE = 0.5, 0.12, 0.25, 0.5
"""Over what change a departure looks different: of the logarithms of distance and of speed, of the
sweep's duration, of radii."""


@dataclass(frozen=True, slots=True, eq=False)
class Process:
    """Hold a smooth process on some rows: where they are, counted in its lengths, and its size."""

    name: str  # the channel that departs, and what its departure depends on
    sweep: int  # number of the sweep where it is another one in each, else -1
    rows: NDArray[np.intp]  # (m,) numbers of the rows
    at: Array  # (m, d) places
    size: Array  # (m,) standard deviation, in that of the rows' noise
    share: Array  # (m,) the same over the reading


def of_thrust(log: SweepLog, sweep: int, model: Model) -> Iterator[Process]:
    """Return processes of a sweep's thrusts, in N."""
    c, turning = log.conditions, ~log.tare
    radius_m, tolerance = model.rig.propulsion.radius_m, WITHIN * model.discrepancy.thrust
    rows = np.arange(len(log))
    share = np.where(turning, tolerance, 0.0)
    near = share * np.mean(c.coverage, axis=0) / (1.0 + (c.plate_z_m / radius_m / NEAR) ** 2)
    distance = np.log(c.plate_z_m / radius_m) / DISTANCE
    faster = np.log(np.maximum(np.sqrt(np.mean(c.speed_rad_s**2, axis=0)), 1.0)) / FASTER
    thrust = np.abs(log.thrust_N)
    typical = float(np.median(thrust[turning]))

    def process(name: str, number: int, share: Array, *at: Array) -> Process:
        return Process(f"thrust: {name}", number, rows, np.stack(at, 1), share * thrust, share)

    yield process("distance", -1, near, distance)
    yield process("speed", -1, share, faster)
    yield process("distance and speed", -1, near, distance, faster)
    yield process("time", sweep, share, _part_of(c.time_s) / TIME)
    if np.ptp(c.plate_x_m[turning]) > 0.1 * radius_m:
        near = share / (1.0 + (c.plate_z_m / radius_m / NEAR) ** 2)
        yield process("lateral position", -1, near, c.plate_x_m / (ASIDE * radius_m))
    if len(np.unique(log.stay)) > 3:
        share = np.full(len(log), tolerance)
        places = 10.0 * log.stay[:, None].astype(float)
        yield Process("thrust: visit", sweep, rows, places, share * typical, share)


def of_speed(log: SweepLog, sweep: int, model: Model) -> Iterator[Process]:
    """Return processes of a sweep's speeds and voltages, in rad/s and V, one after the other."""
    power = log.power
    assert power is not None
    tolerance = model.discrepancy
    c = log.conditions.select(~log.tare)
    rows = np.arange(len(c))
    ratio = c.plate_z_m / model.rig.propulsion.radius_m
    near = (
        WITHIN
        * tolerance.speed_by_plate
        * np.mean(c.coverage, axis=0)
        / (1.0 + (ratio / NEAR) ** 2)
    )
    places = np.stack([np.log(ratio) / DISTANCE, np.log(power.speed_rad_s) / FASTER], 1)
    speed = power.speed_rad_s
    yield Process("speed: distance", -1, rows, places, near * speed, near)
    time = _part_of(c.time_s)[:, None] / TIME
    share = np.full(len(c), WITHIN * tolerance.speed)
    yield Process("speed: time", sweep, rows, time, share * speed, share)
    known = np.flatnonzero(np.isfinite(power.voltage_V))
    both = np.concatenate([rows, len(rows) + np.arange(len(known))])
    read = np.concatenate([speed, power.voltage_V[known]])
    share = np.full(len(both), WITHIN * tolerance.voltage)
    time = np.concatenate([time, time[known]])
    yield Process("speed: supply over time", sweep, both, time, share * read, share)


def variations(logs: Sequence[SweepLog], model: Model) -> Array:
    """Return smooth functions (m, r) of distance and of speed over the thrusts of all sweeps."""
    c, radius_m = [log.conditions for log in logs], model.rig.propulsion.radius_m
    distance = np.concatenate([np.log(one.plate_z_m / radius_m) for one in c])
    speed = np.concatenate([np.sqrt(np.mean(one.speed_rad_s**2, axis=0)) for one in c])
    faster = np.log(np.maximum(speed, 1.0))
    roots = [smooth_root(distance[:, None] / DISTANCE), smooth_root(faster[:, None] / FASTER)]
    return np.hstack([model.discrepancy.law / np.sqrt(2.0) * root for root in roots])


PHRASES = {  # what a departure beyond tolerance means; of others: something that depends on it
    "thrust: distance": "a different law of thrust against distance",
    "thrust: visit": "something that changes from visit to visit",
}


def discrepancies(processes: Sequence[Process], n_rows: int) -> list[Discrepancy]:
    """Return discrepancies of processes whose rows are numbered within the whole evidence."""
    found = []
    ordered = sorted(processes, key=lambda one: (one.name, one.sweep))
    for name, parts in groupby(ordered, key=lambda one: one.name):
        columns = [_columns(list(same), n_rows) for _, same in groupby(parts, lambda p: p.sweep)]
        channel, _, depends = name.partition(": ")
        found.append(
            Discrepancy(
                name=name,
                stage="rpm_to_thrust" if channel == "thrust" else "pwm_to_rpm",
                phrase=PHRASES.get(name, f"something in {channel} that depends on {depends}"),
                columns=np.hstack([one for one, _ in columns]),
                shares=np.hstack([one for _, one in columns]),
                readings=np.hstack([one for one, _ in columns]),
                always=name != "thrust: visit",
            )
        )
    return found


def _columns(parts: Sequence[Process], n_rows: int) -> tuple[Array, Array]:
    """Return the root of a process' covariance (n_rows, r), and the same as shares of readings."""
    root = smooth_root(np.concatenate([part.at for part in parts]))
    rows = np.concatenate([part.rows for part in parts])
    columns, shares = np.zeros((2, n_rows, root.shape[1]))
    columns[rows] = np.concatenate([part.size for part in parts])[:, None] * root
    shares[rows] = np.concatenate([part.share for part in parts])[:, None] * root
    return columns, shares


def _part_of(time_s: Array) -> Array:
    """Return times as parts of the whole duration."""
    span = float(np.ptp(time_s))
    return (time_s - time_s.min()) / span if span > 0.0 else np.zeros_like(time_s)
