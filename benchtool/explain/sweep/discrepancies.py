"""Discrepancies of sweeps: smooth functions of distance, speed, time and plate position.

Each is a Gaussian process of the size of its tolerance, given by a root of its covariance. Sweeps
share functions of plate and speed; functions of time or visit are independent between sweeps.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.explain.engine.evidence import HALF_Z_OVER_R, VISIT, WITHIN, Discrepancy, smooth_root
from benchtool.explain.sweep.log import SweepLog
from benchtool.physics.model import Model

# Correlation lengths: log distance, log speed, share of the duration, lateral position over radius.
DISTANCE, SPEED, TIME, LATERAL = 0.5, 0.12, 0.25, 0.5


@dataclass(frozen=True, slots=True, eq=False)
class Process:
    """Gaussian process on some rows, with positions in correlation lengths."""

    name: str  # channel and variable
    sweep: int  # index of the sweep if independent between sweeps, else -1
    rows: NDArray[np.intp]  # (m,) row indices
    positions: Array  # (m, d) positions
    size: Array  # (m,) prior sd, in the unit of the reading
    share: Array  # (m,) prior sd over the reading


def thrust_processes(log: SweepLog, sweep: int, model: Model) -> Iterator[Process]:
    """Yield processes of a sweep's thrusts, in N."""
    c, is_running = log.conditions, ~log.tare
    radius_m, tolerance = model.rig.propulsion.radius_m, WITHIN * model.discrepancy.thrust
    rows = np.arange(len(log))
    share = np.where(is_running, tolerance, 0.0)
    decay = 1.0 + (c.plate_z_m / radius_m / HALF_Z_OVER_R) ** 2
    near = share * np.mean(c.coverage, axis=0) / decay
    distance = np.log(c.plate_z_m / radius_m) / DISTANCE
    log_speed = np.log(np.maximum(np.sqrt(np.mean(c.speed_rad_s**2, axis=0)), 1.0)) / SPEED
    thrust = np.abs(log.thrust_N)
    typical = float(np.median(thrust[is_running]))

    def process(name: str, index: int, share: Array, *variables: Array) -> Process:
        positions = np.stack(variables, 1)
        return Process(f"thrust: {name}", index, rows, positions, share * thrust, share)

    yield process("distance", -1, near, distance)
    yield process("speed", -1, share, log_speed)
    yield process("distance and speed", -1, near, distance, log_speed)
    yield process("time", sweep, share, _normalize_time(c.time_s) / TIME)
    if np.ptp(c.plate_x_m[is_running]) > 0.1 * radius_m:
        near = share / (1.0 + (c.plate_z_m / radius_m / HALF_Z_OVER_R) ** 2)
        yield process("lateral position", -1, near, c.plate_x_m / (LATERAL * radius_m))
    if len(np.unique(log.stay)) > 3:
        share = np.full(len(log), tolerance)
        positions = 10.0 * log.stay[:, None].astype(float)
        yield Process(VISIT, sweep, rows, positions, share * typical, share)


def speed_processes(log: SweepLog, sweep: int, model: Model) -> Iterator[Process]:
    """Yield processes of a sweep's speeds and voltages, concatenated, in rad/s and V."""
    power = log.power
    assert power is not None
    tolerance = model.discrepancy
    c = log.conditions.select(~log.tare)
    rows = np.arange(len(c))
    ratio = c.plate_z_m / model.rig.propulsion.radius_m
    near_sd = WITHIN * tolerance.speed_by_plate
    near_share = near_sd * np.mean(c.coverage, axis=0) / (1.0 + (ratio / HALF_Z_OVER_R) ** 2)
    positions = np.stack([np.log(ratio) / DISTANCE, np.log(power.speed_rad_s) / SPEED], 1)
    speed = power.speed_rad_s
    yield Process("speed: distance", -1, rows, positions, near_share * speed, near_share)
    time = _normalize_time(c.time_s)[:, None] / TIME
    share = np.full(len(c), WITHIN * tolerance.speed)
    yield Process("speed: time", sweep, rows, time, share * speed, share)
    has_voltage = np.flatnonzero(np.isfinite(power.voltage_V))
    all_rows = np.concatenate([rows, len(rows) + np.arange(len(has_voltage))])
    readings = np.concatenate([speed, power.voltage_V[has_voltage]])
    share = np.full(len(all_rows), WITHIN * tolerance.voltage)
    time = np.concatenate([time, time[has_voltage]])
    yield Process("speed: supply over time", sweep, all_rows, time, share * readings, share)


def variations(logs: Sequence[SweepLog], model: Model) -> Array:
    """Return smooth functions (m, r) of distance and of speed for the thrusts of all sweeps."""
    c, radius_m = [log.conditions for log in logs], model.rig.propulsion.radius_m
    distance = np.concatenate([np.log(v.plate_z_m / radius_m) for v in c])
    speed = np.concatenate([np.sqrt(np.mean(v.speed_rad_s**2, axis=0)) for v in c])
    log_speed = np.log(np.maximum(speed, 1.0))
    roots = [smooth_root(distance[:, None] / DISTANCE), smooth_root(log_speed[:, None] / SPEED)]
    return np.hstack([model.discrepancy.law / np.sqrt(2.0) * root for root in roots])


def discrepancies(processes: Sequence[Process], n_rows: int) -> list[Discrepancy]:
    """Return discrepancies of processes; their rows are indices in the whole evidence."""
    result = []
    ordered = sorted(processes, key=lambda part: (part.name, part.sweep))
    for name, parts in groupby(ordered, key=lambda part: part.name):
        columns = [_columns(list(same), n_rows) for _, same in groupby(parts, lambda p: p.sweep)]
        result.append(
            Discrepancy(
                name=name,
                columns=np.hstack([part for part, _ in columns]),
                shares=np.hstack([part for _, part in columns]),
                readings=np.hstack([part for part, _ in columns]),
            )
        )
    return result


def _columns(processes: Sequence[Process], n_rows: int) -> tuple[Array, Array]:
    """Return the root of a process' covariance (n_rows, r), absolute and relative to readings."""
    root = smooth_root(np.concatenate([process.positions for process in processes]))
    rows = np.concatenate([process.rows for process in processes])
    columns, shares = np.zeros((2, n_rows, root.shape[1]))
    columns[rows] = np.concatenate([process.size for process in processes])[:, None] * root
    shares[rows] = np.concatenate([process.share for process in processes])[:, None] * root
    return columns, shares


def _normalize_time(time_s: Array) -> Array:
    """Return times over the duration, from 0 to 1."""
    duration_s = float(np.ptp(time_s))
    return (time_s - time_s.min()) / duration_s if duration_s > 0.0 else np.zeros_like(time_s)
