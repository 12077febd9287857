"""Whitened innovations of pitch recordings as evidence about model parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from benchtool.core.parameter import Parameters
from benchtool.core.units import Array
from benchtool.explain.engine.evidence import EARLY, LATE, Discrepancy, RowGroups
from benchtool.explain.engine.parameters import (
    RADIUS_KNOWN,
    ScaledParameter,
    all_shape_names,
    effect_parameters,
    owner_parameter,
    parameters_at,
    with_every_effect,
)
from benchtool.explain.pitch.discrepancies import (
    DiscrepancySimulation,
    Whitener,
    discrepancies,
    smooth,
)
from benchtool.explain.pitch.filter import FilterResult, pitch_filter
from benchtool.physics.catalogue import candidates
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model
from benchtool.simulate.pitch.bench import STEPS_PER_LAG, PitchBench, rig_sensors
from benchtool.simulate.pitch.filter_log import LoggedPitch, Predictions, filter_log

PLANT_HZ = 500.0  # minimum rate of plant steps: ten in a motor lag of 20 ms
MIN_LAG_S = 1.001 * STEPS_PER_LAG / PLANT_HZ  # shortest lag at these steps

# Rows of a channel in all recordings; more are averaged. Innovations are white, and effects change
# them over tens of milliseconds.
MAX_ROWS = 40000

LANES = 8  # parameter sets run at once; memory is proportional to it
SETTLING_S = 0.3  # after a restart of the filter, before its innovations are used


class PitchEvidence:
    """Evidence of recordings about a model with every candidate effect."""

    def __init__(
        self,
        model: Model,
        logs: Sequence[LoggedPitch],
        extra: Sequence[Effect] = (),
        n_averaged: int = 0,
    ) -> None:
        self.model = with_every_effect(model, "pitch", extra)
        self._extra_effects = tuple(extra)
        names = {effect.name for effect in (*candidates("pitch"), *extra)}
        self.n_averaged = n_averaged or -(-sum(len(log) for log in logs) // MAX_ROWS)
        self.logs = [self._run_filter(log) for log in logs]
        self.n_discs = logs[0].n_discs
        # The plant's steps do not resolve shorter lags.
        min_lags_s = {
            f"{effect.name}.{effect.parameters[0].name}": MIN_LAG_S
            for effect in self.model.effects
            if effect.hooks.lag_s is not None
        }
        effects = effect_parameters(self.model, names, "pitch", min_lags_s)
        self.parameters = (*effects, *self._owner_parameters())

    def of(self, logs: Sequence[LoggedPitch], n_averaged: int) -> PitchEvidence:
        """Return the evidence of other recordings about the same model."""
        return PitchEvidence(self.model, logs, self._extra_effects, n_averaged)

    # --- parameters ----------------------------------------------------------------------------

    def _owner_parameters(self) -> list[ScaledParameter]:
        parameters = self.model.parameters
        radius, inertia = parameters["R_m"], parameters["inertia_kgm2"]
        default_sd = RADIUS_KNOWN * radius.value
        radius_sd = radius.prior.sd if radius.prior.kind == "normal" else default_sd
        return [
            owner_parameter("inertia_kgm2", inertia, inertia.prior.sd, 0.2 * inertia.value),
            owner_parameter("R_m", radius, radius_sd, 0.2 * radius.value),
            *(
                owner_parameter(
                    name,
                    parameter,
                    parameter.prior.sd,
                    parameter.lower,
                    parameter.lower == parameter.value,
                )
                for name in all_shape_names(self.model, "pitch", self._extra_effects)
                for parameter in [parameters[name]]
            ),
        ]

    # --- data -----------------------------------------------------------------------------

    def _run_filter(self, logged: LoggedPitch) -> FilterResult:
        bench = self._bench(self.model.parameters, logged.rate_Hz)
        filter_ = pitch_filter(
            replace(bench, sensors=rig_sensors(self.model.rig)),
            logged.rate_Hz,
            gyro=bool(np.isfinite(logged.gyro_rad_s).any()),
            speeds=bool(np.isfinite(logged.speed_rad_s).any()),
        )
        is_evidence = np.ones(len(logged), bool)
        n_settling = round(SETTLING_S * logged.rate_Hz)
        for start in (0, *np.flatnonzero(logged.mode == 2.0)):
            is_evidence[start : start + n_settling] = False
        return FilterResult.of(logged, filter_, is_evidence, self.n_averaged)

    def _bench(self, parameters: Parameters, rate_Hz: float) -> PitchBench:
        substeps = max(1, int(np.ceil(PLANT_HZ / rate_Hz)))
        return PitchBench.from_model(
            self.model.with_values(parameters), sensors={}, pwm_quantum_us=0.0,
            plant_rate_Hz=substeps * rate_Hz,
        )  # fmt: skip

    def bench(self, scaled: Array, rate_Hz: float) -> PitchBench:
        """Return the bench with the parameters at scaled values (n_parameters,)."""
        return self._bench(parameters_at(self.model.parameters, self.parameters, scaled), rate_Hz)

    def residuals(self, scaled: Array) -> Array:
        """Return whitened residuals (n_rows, n_sets) for sets (n_sets, n_parameters)."""
        sets = np.atleast_2d(scaled)
        parts = [sets[first : first + LANES] for first in range(0, len(sets), LANES)]
        return np.hstack([self._residuals(part) for part in parts])

    def _residuals(self, sets: Array) -> Array:
        rows: list[Array] = []
        for log in self.logs:
            benches = [self.bench(values, log.logged.rate_Hz) for values in sets]
            lead = round(SETTLING_S * log.logged.rate_Hz)
            pieces = [
                self._whiten_errors(
                    part, filter_log(benches, part.logged, log.filter.gains, start_s=start_s)
                )
                for part, start_s in log.pieces(lead)
            ]
            rows += [np.concatenate(channel) for channel in zip(*pieces, strict=True)]
        return np.concatenate(rows)

    def discrepancies(self) -> tuple[Discrepancy, ...]:
        """Return discrepancies of torques, speeds and readings."""
        return tuple(discrepancies(self.simulate_discrepancies()))

    def varied(self, changes: Array) -> Array:
        """Return smooth variations (n_rows, r) of an effect's contribution."""
        return changes[:, None] * self._variations

    @cached_property
    def _variations(self) -> Array:
        """Relative errors of a law (n_rows, r), smooth in pulse, rate and absolute rate."""
        logs = self.simulate_discrepancies()
        bases = [smooth(logs, name) for name in ("pulse", "rate", "slowness")]
        functions = [np.hstack(parts) for parts in zip(*filter(None, bases), strict=True)]
        rows = [
            np.tile(log.rows(basis), (self._channels(log), 1))
            for basis, log in zip(functions, self.logs, strict=True)
        ]
        return np.asarray(self.model.discrepancy.law / np.sqrt(3.0) * np.concatenate(rows), float)

    def simulate_discrepancies(self) -> list[DiscrepancySimulation]:
        def build_whitener(log: FilterResult) -> Whitener:
            return lambda innovations: np.concatenate(self._whiten(log, list(innovations)))

        covered_disc = int(np.argmax(PitchBench.from_model(self.model).covered))
        return [
            DiscrepancySimulation(log, self.model, covered_disc, index, build_whitener(log))
            for index, log in enumerate(self.logs)
        ]

    def _channels(self, log: FilterResult) -> int:
        """Return the number of channels with rows in a log."""
        return 1 + log.has_gyro + sum(log.has_speed)

    def groups(self) -> RowGroups:
        """Return the stage and the regimes of the rows."""
        speed_masks: list[NDArray[np.bool_]] = []
        regimes: list[dict[str, NDArray[np.bool_]]] = []
        for log in self.logs:
            masks = pitch_regimes(log.logged, self.model.rig.propulsion.radius_m)
            n_sensors = 1 + log.has_gyro
            for is_speed in np.arange(self._channels(log)) >= n_sensors:
                speed_masks.append(np.full(log.n_rows, is_speed))
                regimes.append({name: log.rows(m.astype(float)) > 0.5 for name, m in masks.items()})
        return RowGroups.concatenate("hinge", speed_masks, regimes)

    def _whiten_errors(self, log: FilterResult, run: Predictions) -> tuple[Array, ...]:
        """Return residuals of pitch, gyro and measured speeds, (n_rows, n_sets) each."""
        logged = log.logged
        pitch = logged.theta_rad[:, None] - run.theta_rad
        gyro = logged.gyro_rad_s[:, None] - run.gyro_rad_s
        pairs = zip(logged.speed_rad_s, run.speed_rad_s.swapaxes(0, 1), strict=True)
        return self._whiten(log, [pitch, gyro, *(read[:, None] - speed for read, speed in pairs)])

    def _whiten(self, log: FilterResult, errors: Sequence[Array]) -> tuple[Array, ...]:
        """Return errors (n, r) of pitch, gyro and each disc's speed as whitened rows."""
        whitener = log.filter.whitener
        pitch = np.nan_to_num(errors[0])
        rows = [whitener[0, 0] * pitch]
        if log.has_gyro:  # empty rows would lower the estimated noise
            rows.append(np.nan_to_num(whitener[1, 0] * pitch + whitener[1, 1] * errors[1]))
        speeds = zip(log.has_speed, log.logged.speed_rad_s, errors[2:], strict=True)
        for has_readings, readings, error in speeds:
            if has_readings:
                is_finite = np.isfinite(readings)[:, None]
                rows.append(np.where(is_finite, error, 0.0) / log.filter.speed_sd_rad_s)
        return tuple(np.sqrt(log.n_averaged) * log.rows(row) for row in rows)


NEAR_Z_OVER_R = 2.0  # regime of a near plate; assumed
SLOW_RAD_S = 0.05  # 3 deg/s, limit of slow motion; assumed
REVERSAL_WINDOW_S = 0.15  # before and after a change of sign; assumed


def pitch_regimes(logged: LoggedPitch, radius_m: float) -> dict[str, NDArray[np.bool_]]:
    """Return masks (n,) of regimes by their names in reports."""
    n = len(logged)
    rate = np.nan_to_num(logged.gyro_rad_s)
    if not rate.any():
        rate = np.gradient(np.nan_to_num(logged.theta_rad)) * logged.rate_Hz
    width = max(1, round(0.05 * logged.rate_Hz))
    smooth_rate = np.convolve(rate, np.ones(width) / width, mode="same")
    slow = np.abs(smooth_rate) < SLOW_RAD_S
    is_reversal = np.zeros(n, bool)
    is_reversal[1:] = np.sign(smooth_rate[1:]) != np.sign(smooth_rate[:-1])
    window = np.ones(2 * round(REVERSAL_WINDOW_S * logged.rate_Hz) + 1)
    near_reversal = np.convolve(is_reversal, window, "same") > 0
    mean_us = logged.pwm_us.mean(axis=0)
    change = np.abs(np.gradient(logged.pwm_us[0] - logged.pwm_us[-1]))
    is_steady = np.convolve(change, np.ones(width) / width, "same") < np.median(change) + 1e-9
    low, high = np.quantile(mean_us, [1.0 / 3.0, 2.0 / 3.0])
    covered = logged.plate_share > 0.0
    near = covered & (logged.plate_z_m < NEAR_Z_OVER_R * radius_m)
    time = np.arange(n)
    regimes = {
        f"z/R below {NEAR_Z_OVER_R:g}": near,
        "plate in": covered,
        "plate parked": ~covered,
        "slow reversals": slow & near_reversal,
        "at rest": slow & ~near_reversal,
        "fast motion": np.abs(smooth_rate) > np.quantile(np.abs(smooth_rate), 0.8),
        LATE: time > 2 * n // 3,
        EARLY: time < n // 3,
        "quick changes of the pulses": ~is_steady,
    }
    if high - low > 0.05 * (high - 1000.0):
        regimes |= {"high collective": mean_us >= high, "low collective": mean_us <= low}
    return {name: mask for name, mask in regimes.items() if 0.01 * n < mask.sum() < 0.95 * n}
