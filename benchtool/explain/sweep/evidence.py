"""Whitened thrusts, and speeds at given pulses, of plate sweeps as evidence about a model."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.explain.engine.evidence import (
    HALF_Z_OVER_R,
    VISIT,
    WITHIN,
    Discrepancy,
    RowGroups,
    ScaledParameter,
    all_shape_names,
    effect_parameters,
    known_prior,
    owner_parameter,
    smooth_root,
    with_every_effect,
)
from benchtool.explain.sweep.log import SweepLog, sweep_regimes
from benchtool.fit.uncertainty.bench_errors import bench_errors
from benchtool.physics.bases import speed_factors
from benchtool.physics.catalogue import candidates
from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model

SUPPLY_DROP_V = "supply.drop"
CURVE = "supply.curve"
SPEED_EXPONENT = "supply.followed"
# Voltage drop at full load over the open-circuit voltage; curvature of the discharge; exponent of
# speed over supply at a pulse: 1 for an ideal motor, less under load, 0 for a governed ESC. Values
# for lithium polymer packs; assumed.
SUPPLY_PARAMETERS = (
    ScaledParameter(
        name=SUPPLY_DROP_V, unit="1", effect="", start=0.02, scale=0.02, lower=0.0, upper=0.3,
        held=True
    ),
    ScaledParameter(name=CURVE, unit="1", effect="", start=0.0, scale=0.1, held=True),
    ScaledParameter(
        name=SPEED_EXPONENT, unit="1", effect="", start=1.0, scale=0.5, lower=0.0, upper=1.2,
        held=True
    ),
)  # fmt: skip

SUPPLY_LOSSES = tuple(  # linear loss of the supply, from pulses, speeds and voltage
    f"{effect.name}.{effect.supply_loss}" for effect in candidates("sweep") if effect.supply_loss
)


# Correlation lengths: log distance, log speed, share of the duration, lateral position over radius.
DISTANCE, SPEED, TIME, LATERAL = 0.5, 0.12, 0.25, 0.5


class SweepEvidence:
    """Evidence of sweeps about a model with every candidate effect."""

    def __init__(
        self, model: Model, logs: Sequence[SweepLog], extra: Sequence[Effect] = ()
    ) -> None:
        self._arguments = (model, tuple(extra))
        self.model = with_every_effect(model, "sweep", extra)
        self.logs = tuple(logs)
        effects = effect_parameters(self.model, "sweep", extra)
        self.parameters = (*effects, *self._owner_parameters())
        self._model_index = {name: index for index, name in enumerate(self.model.parameters)}
        self._index = {parameter.name: index for index, parameter in enumerate(self.parameters)}
        # All parameters are free, because a model drops neutral fixed effects.
        free = (p.name for p in self.parameters if p.name in self._model_index)
        self._free_model = self.model.with_free(*free)
        self.noise_roots = tuple(self._noise_root(log) for log in self.logs)
        self.whiteners = tuple(np.linalg.inv(root) for root in self.noise_roots)

    # --- parameters ----------------------------------------------------------------------------

    def _owner_parameters(self) -> list[ScaledParameter]:
        parameters = self.model.parameters
        shapes = all_shape_names(self.model, "sweep", self._arguments[1])
        result = []
        for name in ("k", "R_m", *shapes):
            item, prior = parameters[name], known_prior(name, parameters[name])
            lower = max(item.lower, 0.2 * item.value) if item.value > 0.0 else item.lower
            sd = item.value if prior is None else prior.sd
            result.append(owner_parameter(name, item, sd, lower))
        if any(log.power is not None for log in self.logs):
            result += SUPPLY_PARAMETERS
        return result

    # --- predictions ----------------------------------------------------------------------

    def thrusts(self, conditions: Conditions, scaled: Array) -> Array:
        """Return predicted readings (m, n_sets) for sets (n_sets, n_parameters): N."""
        thrust_N = np.asarray(self._free_model.thrust_N(conditions, self._values_at(scaled)), float)
        return np.broadcast_to(thrust_N, (len(scaled), len(conditions))).T

    def _values_at(self, scaled: Array) -> list[object]:
        """Return the model's values (n_parameters,), each a number or (n_sets, 1)."""
        values: list[object] = list(self.model.parameters.values_array())
        for parameter, row in zip(self.parameters, scaled.T, strict=True):
            if parameter.name in self._model_index:
                column = (parameter.start + parameter.scale * row)[:, None]
                values[self._model_index[parameter.name]] = column
        return values

    def supply(self, log: SweepLog, scaled: Array) -> Array:
        """Return the ratio of supply voltage to its initial open-circuit value (m, n_sets)."""
        assert log.power is not None
        loss = np.sum([self._values(name, scaled) for name in SUPPLY_LOSSES], axis=0)
        curve, drop = self._values(CURVE, scaled), self._values(SUPPLY_DROP_V, scaled)
        return log.power.supply(loss, curve, drop)

    def drive(self, log: SweepLog, scaled: Array) -> Array:
        """Return the ratio of speed to that at full supply and OGE (n_rotors or 1, m, n_sets).

        There is one row for all rotors if the plate does not change their speeds.
        """
        assert log.power is not None
        supply, model = self.supply(log, scaled)[None], self._free_model
        supply = supply ** self._values(SPEED_EXPONENT, scaled)
        if model.motor_slope_Nm_s is None:
            return supply
        values = self._values_at(scaled)
        flow = model.flow(log.conditions.select(~log.tare), values)
        by_plate: Array = np.array([gain.T for gain in speed_factors(model, flow, values)])
        by_rotor: Array = by_plate[model.rig.disc_of_rotor][: len(log.power.rotor_rad_s)]
        return supply * by_rotor

    def _values(self, name: str, scaled: Array) -> Array:
        """Return a parameter's values (n_sets,)."""
        index = self._index[name]
        return self.parameters[index].start + self.parameters[index].scale * scaled[:, index]

    def predicted(self, log: SweepLog, scaled: Array, readings: Array) -> Array:
        """Return rotor speeds predicted from earlier readings, (n, m, n_sets or 1) in rad/s."""
        assert log.power is not None
        return log.power.predicted(self.drive(log, scaled), readings)

    def of(self, log: SweepLog) -> SweepEvidence:
        """Return the evidence of one other sweep about the same model."""
        model, extra = self._arguments
        return SweepEvidence(model, [log], extra)

    def with_other(self, other: SweepEvidence) -> SweepEvidence:
        """Return the evidence of these sweeps followed by others about the same model."""
        combined = copy(self)
        combined.logs = (*self.logs, *other.logs)
        combined.noise_roots = (*self.noise_roots, *other.noise_roots)
        combined.whiteners = (*self.whiteners, *other.whiteners)
        return combined

    def _noise_root(self, log: SweepLog) -> Array:
        """Return the root (m, m) of the covariance of the sweep's thrusts: N."""
        parameters = self.model.parameters
        se = np.hypot(parameters["noise.scale"].value * log.se_N, parameters["noise.sd_N"].value)
        covariance = np.diag(se**2)
        for source in bench_errors(self.model, log.conditions, log.visits):
            covariance += source.columns @ source.columns.T
        root: Array = np.linalg.cholesky(covariance)
        return root

    # --- evidence -------------------------------------------------------------------------

    def residuals(self, scaled: Array) -> Array:
        sets = np.atleast_2d(scaled)
        rows = []
        for log, whitener in zip(self.logs, self.whiteners, strict=True):
            predicted_N = self.thrusts(log.conditions, sets)
            rows.append(whitener @ (log.thrust_N[:, None] - predicted_N))
            power = log.power
            if power is not None:
                errors = power.speed_rad_s[:, None] - power.speeds(self.drive(log, sets))
                rows.append(errors / power.speed_se[:, None])
                measured = np.isfinite(power.voltage_V)
                if measured.any():
                    predicted_V = power.voltages(self.supply(log, sets))
                    errors = (power.voltage_V[:, None] - predicted_V)[measured]
                    rows.append(errors / power.voltage_se)
        return np.concatenate(rows)

    def discrepancies(self) -> tuple[Discrepancy, ...]:
        """Return smooth functions of distance, speed, time and plate position.

        Sweeps share functions of plate and speed; those of time or visit are independent.
        """
        result = []
        ordered = sorted(self._processes(), key=lambda part: (part.name, part.sweep))
        for name, parts in groupby(ordered, key=lambda part: part.name):
            sweeps = groupby(parts, key=lambda part: part.sweep)
            pairs = [self._columns(list(same)) for _, same in sweeps]
            readings, shares = (np.hstack(columns) for columns in zip(*pairs, strict=True))
            columns = self._whiten(readings)
            result.append(Discrepancy(name=name, columns=columns, shares=shares, readings=readings))
        return tuple(result)

    def _columns(self, processes: Sequence[Process]) -> tuple[Array, Array]:
        """Return the root of a covariance (n_rows, r), absolute and relative to readings."""
        root = smooth_root(np.concatenate([process.positions for process in processes]))
        rows = np.concatenate([process.rows for process in processes])
        columns, shares = np.zeros((2, self._n_rows, root.shape[1]))
        columns[rows] = np.concatenate([process.size for process in processes])[:, None] * root
        shares[rows] = np.concatenate([process.share for process in processes])[:, None] * root
        return columns, shares

    def varied(self, changes: Array) -> Array:
        c, radius_m = [log.conditions for log in self.logs], self.model.rig.propulsion.radius_m
        distance = np.concatenate([np.log(v.plate_z_m / radius_m) for v in c])
        log_speed = np.concatenate([_log_speed(v) for v in c])
        roots = [smooth_root(distance[:, None] / DISTANCE), smooth_root(log_speed[:, None] / SPEED)]
        size = self.model.discrepancy.law / np.sqrt(2.0)
        functions = np.hstack([size * root for root in roots])
        parts = np.split(changes[self.thrust_rows], np.cumsum([len(log) for log in self.logs])[:-1])
        pairs = zip(self.noise_roots, parts, strict=True)
        contribution = np.concatenate([root @ part for root, part in pairs])
        return self.whiten_thrusts(contribution[:, None] * functions)

    def whiten_thrusts(self, changes_N: Array) -> Array:
        """Return whitened rows (n_rows, r) of changes of thrusts (m, r)."""
        changes = np.zeros((self._n_rows, changes_N.shape[1]))
        changes[self.thrust_rows] = changes_N
        return self._whiten(changes)

    def rows(self) -> Iterator[tuple[SweepLog, slice, slice]]:
        """Yield each log with its rows of thrusts, and of speeds and voltages."""
        first = 0
        for log in self.logs:
            middle = first + len(log)
            last = middle + (log.power.n_rows if log.power is not None else 0)
            yield log, slice(first, middle), slice(middle, last)
            first = last

    @property
    def thrust_rows(self) -> NDArray[np.intp]:
        """Indices of the rows of thrusts."""
        return np.concatenate([np.arange(rows.start, rows.stop) for _, rows, _ in self.rows()])

    def _processes(self) -> Iterator[Process]:
        """Yield the Gaussian processes of all logs, with row indices of `residuals`."""
        for sweep, (log, *parts) in enumerate(self.rows()):
            for build, rows in zip((thrust_processes, speed_processes), parts, strict=True):
                if rows.stop > rows.start:
                    for process in build(log, sweep, self.model):
                        yield replace(process, rows=rows.start + process.rows)

    @property
    def _n_rows(self) -> int:
        return int(max(speeds.stop for _, _, speeds in self.rows()))

    def _whiten(self, changes: Array) -> Array:
        """Return whitened rows of changes of readings (n_rows, r)."""
        whitened = np.empty_like(changes)
        for (log, thrusts, speeds), whitener in zip(self.rows(), self.whiteners, strict=True):
            whitened[thrusts] = whitener @ changes[thrusts]
            if log.power is not None:
                whitened[speeds] = log.power.whiten_changes(changes[speeds])
        return whitened

    def groups(self) -> RowGroups:
        is_speed: list[NDArray[np.bool_]] = []
        regimes: list[dict[str, NDArray[np.bool_]]] = []
        for log in self.logs:
            rows = np.arange(len(log))
            if log.power is not None:
                running = np.flatnonzero(~log.tare)
                has_voltage = np.isfinite(log.power.voltage_V)
                rows = np.concatenate([rows, running, running[has_voltage]])
            is_speed.append(np.arange(len(rows)) >= len(log))
            masks = sweep_regimes(log, self.model)
            regimes.append({name: mask[rows] for name, mask in masks.items()})
        return RowGroups.concatenate("rpm_to_thrust", is_speed, regimes)


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
    log_speed = _log_speed(c) / SPEED
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


def _log_speed(conditions: Conditions) -> Array:
    speed = np.sqrt(np.mean(conditions.speed_rad_s**2, axis=0))
    return np.asarray(np.log(np.maximum(speed, 1.0)), float)


def _normalize_time(time_s: Array) -> Array:
    """Return times over the duration, from 0 to 1."""
    duration_s = float(np.ptp(time_s))
    return (time_s - time_s.min()) / duration_s if duration_s > 0.0 else np.zeros_like(time_s)
