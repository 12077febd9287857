"""Whitened innovations of pitch recordings as evidence about model parameters."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.explain.engine.evidence import (
    EARLY,
    LATE,
    RADIUS_KNOWN,
    Discrepancy,
    RowGroups,
    ScaledParameter,
    all_shape_names,
    effect_parameters,
    owner_parameter,
    parameters_at,
    smooth_root,
    with_every_effect,
)
from benchtool.explain.pitch.filter import FilteredLog
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model
from benchtool.simulate.pitch.bench import STEPS_PER_LAG, PitchBench
from benchtool.simulate.pitch.filter_log import LoggedPitch, filter_log

PLANT_HZ = 500.0  # minimum rate of plant steps: ten in a motor lag of 20 ms
MIN_LAG_S = 1.001 * STEPS_PER_LAG / PLANT_HZ  # shortest lag at these steps

# Rows of a channel in all recordings; more are averaged. Innovations are white, and effects change
# them over tens of milliseconds.
MAX_ROWS = 40000

LENGTH = 0.3  # correlation length of a discrepancy, in shares of its variable's range
RESOLUTION = 0.05  # of positions, in correlation lengths

VARIABLES = {  # variables of each kind of discrepancy
    "torque": ("angle", "rate", "thrust", "time", "distance"),
    "speed": ("pulse", "time", "distance"),
    "reading": ("angle", "rate"),
}


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
        self.n_averaged = n_averaged or -(-sum(len(log) for log in logs) // MAX_ROWS)
        self.logs = [
            FilteredLog.of(log, self.model, index, self.n_averaged)
            for index, log in enumerate(logs)
        ]
        # The plant's steps do not resolve shorter lags.
        min_lags_s = {
            f"{effect.name}.{effect.parameters[0].name}": MIN_LAG_S
            for effect in self.model.effects
            if effect.hooks.lag_s is not None
        }
        effects = effect_parameters(self.model, "pitch", extra, min_lags_s)
        self.parameters = (*effects, *self._owner_parameters())

    def of(self, logs: Sequence[LoggedPitch], n_averaged: int) -> PitchEvidence:
        """Return the evidence of other recordings about the same model."""
        return PitchEvidence(self.model, logs, self._extra_effects, n_averaged)

    def _owner_parameters(self) -> list[ScaledParameter]:
        parameters = self.model.parameters
        radius, inertia = parameters["R_m"], parameters["inertia_kgm2"]
        default_sd = RADIUS_KNOWN * radius.value
        radius_sd = radius.prior.sd if radius.prior.kind == "normal" else default_sd
        return [
            owner_parameter("inertia_kgm2", inertia, inertia.prior.sd, 0.2 * inertia.value),
            owner_parameter("R_m", radius, radius_sd, 0.2 * radius.value),
            *(
                owner_parameter(name, k, k.prior.sd, k.lower, k.lower == k.value)
                for name in all_shape_names(self.model, "pitch", self._extra_effects)
                for k in [parameters[name]]
            ),
        ]

    def bench(self, scaled: Array, rate_Hz: float) -> PitchBench:
        """Return the bench with the parameters at scaled values (n_parameters,)."""
        parameters = parameters_at(self.model.parameters, self.parameters, scaled)
        substeps = max(1, int(np.ceil(PLANT_HZ / rate_Hz)))
        return PitchBench.from_model(
            self.model.with_values(parameters), sensors={}, pwm_quantum_us=0.0,
            plant_rate_Hz=substeps * rate_Hz,
        )  # fmt: skip

    def residuals(self, scaled: Array) -> Array:
        sets = np.atleast_2d(scaled)
        ends = np.cumsum([log.n_channels * log.n_rows for log in self.logs])
        rows = np.empty((ends[-1], len(sets)))
        for log, block in zip(self.logs, np.split(rows, ends[:-1]), strict=True):
            benches = [self.bench(values, log.logged.rate_Hz) for values in sets]
            channels, first = block.reshape(log.n_channels, log.n_rows, -1), 0
            for part in log.pieces():
                logged, selected = part.logged, part.selected
                run = filter_log(benches, logged, log.filter.gains)
                readings = [logged.theta_rad, logged.gyro_rad_s, *logged.speed_rad_s]
                predictions = [run.theta_rad, run.gyro_rad_s, *run.speed_rad_s.swapaxes(0, 1)]
                pairs = zip(readings, predictions, strict=True)
                errors = [read[selected, None] - value[selected] for read, value in pairs]
                part.whiten(errors, channels[:, first : first + part.n_rows])
                first += part.n_rows
        return rows

    def discrepancies(self) -> tuple[Discrepancy, ...]:
        """Return torques, speeds and reading errors, each a smooth function of one variable."""
        result = []
        for channel, variables in VARIABLES.items():
            for variable in variables:
                if (bases := smooth(self.logs, variable)) is None:
                    continue
                name = f"{channel}: {variable}"
                pairs = zip(self.logs, bases, strict=True)
                pieces = [log.whitened_rows(name, basis) for log, basis in pairs]
                columns, shares = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
                if columns.any():
                    result.append(Discrepancy(name=name, columns=columns, shares=shares))
        return tuple(result)

    def varied(self, changes: Array) -> Array:
        return changes[:, None] * self._variations

    @cached_property
    def _variations(self) -> Array:
        """Relative errors of a law (n_rows, r), smooth in pulse, rate and absolute rate."""
        bases = [smooth(self.logs, name) for name in ("pulse", "rate", "slowness")]
        functions = [np.hstack(parts) for parts in zip(*filter(None, bases), strict=True)]
        rows = [
            np.tile(log.average(basis), (log.n_channels, 1))
            for basis, log in zip(functions, self.logs, strict=True)
        ]
        return np.asarray(self.model.discrepancy.law / np.sqrt(3.0) * np.concatenate(rows), float)

    def groups(self) -> RowGroups:
        speed_masks: list[NDArray[np.bool_]] = []
        regimes: list[dict[str, NDArray[np.bool_]]] = []
        for log in self.logs:
            speed_masks.append(np.repeat(np.arange(log.n_channels) > log.has_gyro, log.n_rows))
            regimes.append(
                {
                    name: np.tile(log.average(mask.astype(float)) > 0.5, log.n_channels)
                    for name, mask in pitch_regimes(log).items()
                }
            )
        return RowGroups.concatenate("hinge", speed_masks, regimes)


def smooth(logs: Sequence[FilteredLog], variable: str) -> list[Array] | None:
    """Return smooth functions (n, r) of unit size over a variable, for each recording.

    All recordings share the functions; None if the variable hardly changes.
    """
    parts = [log.values(variable) for log in logs]
    values = np.concatenate(parts)
    is_finite = np.isfinite(values)
    if np.mean(is_finite) < 0.01:
        return None
    positions = values[is_finite]
    if variable not in ("time", "distance"):
        low, high = np.quantile(positions, [0.01, 0.99])
        if not high - low > 1e-9:
            return None
        positions = np.clip(positions, low, high) / (LENGTH * (high - low))
    basis = smooth_root(positions[:, None], RESOLUTION)
    all_rows = np.zeros((len(values), basis.shape[1]))
    all_rows[is_finite] = basis
    return np.split(all_rows, np.cumsum([len(part) for part in parts])[:-1])


NEAR_Z_OVER_R = 2.0  # regime of a near plate; assumed
SLOW_RAD_S = 0.05  # 3 deg/s, limit of slow motion; assumed
REVERSAL_WINDOW_S = 0.15  # before and after a change of sign; assumed


def pitch_regimes(log: FilteredLog) -> dict[str, NDArray[np.bool_]]:
    """Return masks (n,) of regimes by their names in reports."""
    logged, n = log.logged, len(log.logged)
    width = max(1, round(0.05 * logged.rate_Hz))
    smooth_rate = np.convolve(log.rate, np.ones(width) / width, mode="same")
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
    near = covered & (logged.plate_z_m < NEAR_Z_OVER_R * log.model.rig.propulsion.radius_m)
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
