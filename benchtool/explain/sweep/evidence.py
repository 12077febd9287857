"""What plate sweeps say about a model's numbers: thrust, and speeds at given pulses, whitened."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.explain.engine.evidence import Discrepancy, RowGroups
from benchtool.explain.engine.parameters import (
    ScaledParameter,
    all_shape_names,
    effect_parameters,
    known_prior,
    owner_parameter,
    with_every_effect,
)
from benchtool.explain.sweep.discrepancies import (
    Process,
    discrepancies,
    of_speed,
    of_thrust,
    variations,
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
FOLLOWS = "supply.followed"
SUPPLY_PARAMETERS = (
    ScaledParameter(
        name=SUPPLY_DROP_V, unit="1", effect="", start=0.02, scale=0.02, lower=0.0, upper=0.3,
        held=True
    ),
    ScaledParameter(name=CURVE, unit="1", effect="", start=0.0, scale=0.1, held=True),
    ScaledParameter(
        name=FOLLOWS, unit="1", effect="", start=1.0, scale=0.5, lower=0.0, upper=1.2, held=True
    ),
)  # fmt: skip
"""Share of the open voltage that full load takes, how far a discharge is from a straight line, and
the power of the supply with which speed at a pulse goes: 1 of an ideal motor, less of one under
load, 0 where the ESC governs the speed; guesses for lithium polymer packs."""

SUPPLY_LOSSES = tuple(  # linear loss of the supply, seen in pulses beside speeds and voltage
    f"{effect.name}.{effect.supply_loss}" for effect in candidates("sweep") if effect.supply_loss
)


class SweepEvidence:
    """Hold sweeps against a model and every candidate effect."""

    def __init__(
        self,
        model: Model,
        logs: Sequence[SweepLog],
        extra: Sequence[Effect] = (),
    ) -> None:
        self._given = (model, tuple(extra))
        self.model = with_every_effect(model, "sweep", extra)
        self.logs = tuple(logs)
        names = {effect.name for effect in (*candidates("sweep"), *extra)}
        self.parameters = (
            *effect_parameters(self.model, names, "sweep"),
            *self._owner_parameters(),
        )
        self._places = {name: place for place, name in enumerate(self.model.parameters)}
        self._place_of = {parameter.name: place for place, parameter in enumerate(self.parameters)}
        # Every parameter acts, wherever it stands: a model leaves out what is neutral and fixed.
        self._acting = self.model.with_free(
            *(k.name for k in self.parameters if k.name in self._places)
        )
        self.noise_roots = tuple(self._noise_root(log) for log in self.logs)
        self.whiteners = tuple(np.linalg.inv(root) for root in self.noise_roots)

    # --- parameters ----------------------------------------------------------------------------

    def _owner_parameters(self) -> list[ScaledParameter]:
        items = self.model.parameters
        shapes = all_shape_names(self.model, "sweep", self._given[1])
        out = []
        for name in ("k", "R_m", *shapes):
            item, prior = items[name], known_prior(name, items[name])
            lower = max(item.lower, 0.2 * item.value) if item.value > 0.0 else item.lower
            sd = item.value if prior is None else prior.sd
            out.append(owner_parameter(name, item, sd, lower))
        if any(log.power is not None for log in self.logs):
            out += SUPPLY_PARAMETERS
        return out

    # --- predictions ----------------------------------------------------------------------

    def thrusts(self, conditions: Conditions, scaled: Array) -> Array:
        """Return predicted readings (m, n_sets) for sets (n_sets, n_parameters): N."""
        shown = np.asarray(self._acting.thrust_N(conditions, self._at(scaled)), float)
        return np.broadcast_to(shown, (len(scaled), len(conditions))).T

    def _at(self, scaled: Array) -> list[object]:
        """Return the model's values (n_parameters,), each a number or one for each set (n, 1)."""
        values: list[object] = list(self.model.parameters.values_array())
        for parameter, row in zip(self.parameters, scaled.T, strict=True):
            if parameter.name in self._places:
                values[self._places[parameter.name]] = (parameter.start + parameter.scale * row)[
                    :, None
                ]
        return values

    def supply(self, log: SweepLog, scaled: Array) -> Array:
        """Return supply voltage over its open value at the start (m, n_sets)."""
        assert log.power is not None
        loss = np.sum([self._values(name, scaled) for name in SUPPLY_LOSSES], axis=0)
        return log.power.supply(
            loss, self._values(CURVE, scaled), self._values(SUPPLY_DROP_V, scaled)
        )

    def drive(self, log: SweepLog, scaled: Array) -> Array:
        """Return speed over that at full supply far from the plate (n or 1, m, n_sets).

        For every rotor that was read, or one for all where the plate does not change speeds.
        """
        assert log.power is not None
        supply, model = self.supply(log, scaled)[None], self._acting
        supply = supply ** self._values(FOLLOWS, scaled)
        if model.motor_slope_Nm_s is None:
            return supply
        values = self._at(scaled)
        flow = model.flow(log.conditions.select(~log.tare), values)
        by_plate: Array = np.array([gain.T for gain in speed_factors(model, flow, values)])
        by_rotor: Array = by_plate[model.rig.disc_of_rotor][: len(log.power.rotor_rad_s)]
        return supply * by_rotor

    def _values(self, name: str, scaled: Array) -> Array:
        """Return a parameter's values (n_sets,)."""
        place = self._place_of[name]
        return self.parameters[place].start + self.parameters[place].scale * scaled[:, place]

    def speeds(self, log: SweepLog, scaled: Array) -> Array:
        """Return speeds at the log's pulses (m, n_sets), each level's scale fitted: rad/s."""
        assert log.power is not None
        return log.power.speeds(self.drive(log, scaled))

    def predicted(self, log: SweepLog, scaled: Array, read: Array) -> Array:
        """Return each rotor's speeds as `read` ones of earlier visits predict them, in rad/s.

        (n, m, n_sets) or (n, m, 1) each.
        """
        assert log.power is not None
        return log.power.predicted(self.drive(log, scaled), read)

    def voltages(self, log: SweepLog, scaled: Array) -> Array:
        """Return voltages (m, n_sets), the open one fitted: V."""
        assert log.power is not None
        return log.power.voltages(self.supply(log, scaled))

    def of(self, log: SweepLog) -> SweepEvidence:
        """Return the evidence of another sweep about the same model."""
        model, extra = self._given
        return SweepEvidence(model, [log], extra)

    def with_other(self, other: SweepEvidence) -> SweepEvidence:
        """Return the evidence of these sweeps and, behind them, of others about the same model."""
        both = copy(self)
        both.logs = (*self.logs, *other.logs)
        both.noise_roots = (*self.noise_roots, *other.noise_roots)
        both.whiteners = (*self.whiteners, *other.whiteners)
        return both

    def _noise_root(self, log: SweepLog) -> Array:
        """Return the root (m, m) of the covariance of the sweep's thrusts: N."""
        items = self.model.parameters
        se = np.hypot(items["noise.scale"].value * log.se_N, items["noise.sd_N"].value)
        covariance = np.diag(se**2)
        for source in bench_errors(self.model, log.conditions, log.visits):
            covariance += source.columns @ source.columns.T
        root: Array = np.linalg.cholesky(covariance)
        return root

    # --- evidence -------------------------------------------------------------------------

    def residuals(self, scaled: Array) -> Array:
        """Return whitened residuals (n_rows, n_sets) for sets (n_sets, n_parameters)."""
        sets = np.atleast_2d(scaled)
        rows = []
        for log, whitener in zip(self.logs, self.whiteners, strict=True):
            shown = self.thrusts(log.conditions, sets)
            rows.append(whitener @ (log.thrust_N[:, None] - shown))
            power = log.power
            if power is not None:
                missed = power.speed_rad_s[:, None] - self.speeds(log, sets)
                rows.append(missed / power.speed_se[:, None])
                read = np.isfinite(power.voltage_V)
                if read.any():
                    missed = power.voltage_V[read, None] - self.voltages(log, sets)[read]
                    rows.append(missed / power.voltage_se)
        return np.concatenate(rows)

    def discrepancies(self) -> tuple[Discrepancy, ...]:
        """Return the ways in which thrusts, speeds and voltages may depart from every law."""
        found = discrepancies(list(self._processes()), self._n_rows)
        return tuple(replace(one, columns=self._white_changes(one.columns)) for one in found)

    def varied(self, changes: Array) -> Array:
        """Return smooth variations (n_rows, r) of what an effect changes in thrusts."""
        functions = variations(self.logs, self.model)
        parts = np.split(changes[self.thrust_rows], np.cumsum([len(log) for log in self.logs])[:-1])
        roots = zip(self.noise_roots, parts, strict=True)
        changed = np.concatenate([root @ part for root, part in roots])
        return self.white_thrusts(changed[:, None] * functions)

    def white_thrusts(self, changes_N: Array) -> Array:
        """Return what changes of thrusts (m, r) change in whitened residuals (n_rows, r)."""
        out = np.zeros((self._n_rows, changes_N.shape[1]))
        out[self.thrust_rows] = changes_N
        return self._white_changes(out)

    @property
    def thrust_rows(self) -> NDArray[np.intp]:
        """Numbers of the rows that are thrusts."""
        first, rows = 0, []
        for log in self.logs:
            rows.append(first + np.arange(len(log)))
            first += len(log) + (log.power.n_rows if log.power else 0)
        return np.concatenate(rows)

    def _processes(self) -> Iterator[Process]:
        """Return the processes of every log, rows numbered as those of `residuals`."""
        first = 0
        for sweep, log in enumerate(self.logs):
            parts = [(of_thrust, len(log))]
            if log.power is not None:
                parts.append((of_speed, log.power.n_rows))
            for of, count in parts:
                for one in of(log, sweep, self.model):
                    yield replace(one, rows=first + one.rows)
                first += count

    @property
    def _n_rows(self) -> int:
        return sum(len(log) + (log.power.n_rows if log.power else 0) for log in self.logs)

    def _white_changes(self, changes: Array) -> Array:
        """Return changes of readings (n_rows, r) as those of whitened residuals."""
        out, first = np.empty_like(changes), 0
        for log, whitener in zip(self.logs, self.whiteners, strict=True):
            last = first + len(log)
            out[first:last] = whitener @ changes[first:last]
            power = log.power
            if power is not None:
                first, last = last, last + power.n_rows
                out[first:last] = power.white_changes(changes[first:last])
            first = last
        return out

    def groups(self) -> RowGroups:
        """Return labels of the rows: which stage they show, which part of the sweep."""
        turning: list[NDArray[np.bool_]] = []
        regimes: list[dict[str, NDArray[np.bool_]]] = []
        for log in self.logs:
            found = sweep_regimes(log, self.model)
            turning.append(np.zeros(len(log), bool))
            regimes.append(found)
            power = log.power
            if power is not None:
                running = ~log.tare
                for rows in (np.ones(len(power.time_s), bool), np.isfinite(power.voltage_V)):
                    turning.append(np.ones(int(rows.sum()), bool))
                    regimes.append({name: mask[running][rows] for name, mask in found.items()})
        return RowGroups.joined("rpm_to_thrust", turning, regimes)
