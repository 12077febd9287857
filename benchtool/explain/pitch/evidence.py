"""What pitch recordings say about a model's numbers: innovations along the log, whitened."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
from benchtool.core.parameter import Parameters
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
    White,
    discrepancies,
    smooth,
)
from benchtool.explain.pitch.filter import FilterResult, pitch_filter
from benchtool.physics.catalogue import candidates
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model
from benchtool.simulate.pitch.bench import STEPS_PER_LAG, PitchBench, rig_sensors
from benchtool.simulate.pitch.filter_log import LoggedPitch, Predictions, filter_log

PLANT_HZ = 500.0  # least plant steps per second; a motor lag of 20 ms then takes ten of them
MIN_LAG_S = 1.001 * STEPS_PER_LAG / PLANT_HZ  # shortest lag at these steps

MAX_ROWS = 40000
"""Rows of a channel in all recordings together; longer ones are averaged over as many ticks as it
takes. Innovations are white, and what explains them changes over tens of milliseconds."""

LANES = 8  # sets of parameters run at once; each takes as much memory as a piece
SETTLING_S = 0.3  # what a filter needs after it began anew before its innovations count


class PitchEvidence:
    """Hold recordings against a model and every candidate effect."""

    def __init__(
        self,
        model: Model,
        logs: Sequence[LoggedPitch],
        extra: Sequence[Effect] = (),
        together: int = 0,
    ) -> None:
        self.model = with_every_effect(model, "pitch", extra)
        self._extra = tuple(extra)
        names = {effect.name for effect in (*candidates("pitch"), *extra)}
        self.together = together or -(-sum(len(log) for log in logs) // MAX_ROWS)
        self.logs = [self._prepared(log) for log in logs]
        self.n_discs = logs[0].n_discs
        # Below these the plant's steps cannot follow a lag.
        shortest = {
            f"{effect.name}.{effect.parameters[0].name}": MIN_LAG_S
            for effect in self.model.effects
            if effect.hooks.lag_s is not None
        }
        self.parameters = (
            *effect_parameters(self.model, names, "pitch", shortest),
            *self._owner_parameters(),
        )

    def of(self, logs: Sequence[LoggedPitch], together: int) -> PitchEvidence:
        """Return the evidence of other recordings about the same model."""
        return PitchEvidence(self.model, logs, self._extra, together)

    # --- parameters ----------------------------------------------------------------------------

    def _owner_parameters(self) -> list[ScaledParameter]:
        items = self.model.parameters
        radius, inertia = items["R_m"], items["inertia_kgm2"]
        known = RADIUS_KNOWN * radius.value
        radius_sd = radius.prior.sd if radius.prior.kind == "normal" else known
        return [
            owner_parameter("inertia_kgm2", inertia, inertia.prior.sd, 0.2 * inertia.value),
            owner_parameter("R_m", radius, radius_sd, 0.2 * radius.value),
            *(
                owner_parameter(name, item, item.prior.sd, item.lower, item.lower == item.value)
                for name in all_shape_names(self.model, "pitch", self._extra)
                for item in [items[name]]
            ),
        ]

    # --- data -----------------------------------------------------------------------------

    def _prepared(self, logged: LoggedPitch) -> FilterResult:
        bench = self._bench(self.model.parameters, logged.rate_Hz)
        filter_ = pitch_filter(
            replace(bench, sensors=rig_sensors(self.model.rig)),
            logged.rate_Hz,
            gyro=bool(np.isfinite(logged.gyro_rad_s).any()),
            speeds=bool(np.isfinite(logged.speed_rad_s).any()),
        )
        counted = np.ones(len(logged), bool)
        wait = round(SETTLING_S * logged.rate_Hz)
        for start in (0, *np.flatnonzero(logged.mode == 2.0)):
            counted[start : start + wait] = False
        return FilterResult.of(logged, filter_, counted, self.together)

    def _bench(self, parameters: Parameters, rate_Hz: float) -> PitchBench:
        substeps = max(1, int(np.ceil(PLANT_HZ / rate_Hz)))
        return PitchBench.of(
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
            benches = [self.bench(one, log.logged.rate_Hz) for one in sets]
            lead = round(SETTLING_S * log.logged.rate_Hz)
            pieces = [
                self.whitened(
                    part, filter_log(benches, part.logged, log.filter.gains, start_s=start_s)
                )
                for part, start_s in log.pieces(lead)
            ]
            rows += [np.concatenate(channel) for channel in zip(*pieces, strict=True)]
        return np.concatenate(rows)

    def discrepancies(self) -> tuple[Discrepancy, ...]:
        """Return the ways in which torques, speeds and readings may depart from every law."""
        return tuple(discrepancies(self.departing()))

    def varied(self, changes: Array) -> Array:
        """Return smooth variations (n_rows, r) of what an effect changes."""
        return changes[:, None] * self._variations

    @cached_property
    def _variations(self) -> Array:
        """Smooth functions (n_rows, r) of pulse, rate and its size, as a law may be off."""
        parts = [smooth(self.departing(), name) for name in ("pulse", "rate", "slowness")]
        functions = [np.hstack(roots) for roots in zip(*filter(None, parts), strict=True)]
        rows = [
            np.tile(log.rows(root), (self._channels(log), 1))
            for root, log in zip(functions, self.logs, strict=True)
        ]
        return np.asarray(self.model.discrepancy.law / np.sqrt(3.0) * np.concatenate(rows), float)

    def departing(self) -> list[DiscrepancySimulation]:
        def white(log: FilterResult) -> White:
            return lambda shown: np.concatenate(self._white(log, list(shown)))

        over = int(np.argmax(PitchBench.of(self.model).covered))
        return [
            DiscrepancySimulation(log, self.model, over, number, white(log))
            for number, log in enumerate(self.logs)
        ]

    def _channels(self, log: FilterResult) -> int:
        """Return how many channels of a log have rows."""
        return 1 + log.has_gyro + sum(log.has_speed)

    def groups(self) -> RowGroups:
        """Return labels of the rows: which stage they show, which part of the recording."""
        speeds: list[NDArray[np.bool_]] = []
        regimes: list[dict[str, NDArray[np.bool_]]] = []
        for log in self.logs:
            found = pitch_regimes(log.logged, self.model.rig.propulsion.radius_m)
            sensors = 1 + log.has_gyro
            for of_speed in np.arange(self._channels(log)) >= sensors:
                speeds.append(np.full(log.n_rows, of_speed))
                regimes.append(
                    {name: log.rows(mask.astype(float)) > 0.5 for name, mask in found.items()}
                )
        return RowGroups.joined("hinge", speeds, regimes)

    def whitened(self, log: FilterResult, found: Predictions) -> tuple[Array, ...]:
        """Return residuals of pitch, gyro and speeds that were read, (n_rows, n_sets) each."""
        logged = log.logged
        missed = [
            logged.theta_rad[:, None] - found.theta_rad,
            logged.gyro_rad_s[:, None] - found.gyro_rad_s,
        ]
        missed += [
            logged.speed_rad_s[i][:, None] - found.speed_rad_s[:, i] for i in range(self.n_discs)
        ]
        return self._white(log, missed)

    def _white(self, log: FilterResult, missed: Sequence[Array]) -> tuple[Array, ...]:
        """Return errors (n, r) of pitch, gyro and each disc's speed as whitened rows."""
        w = log.filter.whitener
        pitch = np.nan_to_num(missed[0])
        rows = [w[0, 0] * pitch]
        if log.has_gyro:  # rows without any would make all others look like less than noise
            rows.append(np.nan_to_num(w[1, 0] * pitch + w[1, 1] * missed[1]))
        speeds = zip(log.has_speed, log.logged.speed_rad_s, missed[2:], strict=True)
        for was_read, read, error in speeds:
            if was_read:
                known = np.isfinite(read)[:, None]
                rows.append(np.where(known, error, 0.0) / log.filter.speed_sd_rad_s)
        return tuple(np.sqrt(log.together) * log.rows(row) for row in rows)


NEAR_Z_OVER_R = 2.0  # below this distance over radius the plate is near; assumed
SLOW_RAD_S = 0.05  # below this rate the beam is slow; assumed, 3 degrees a second
REVERSAL_WINDOW_S = 0.15  # how long before and after a change of sign a reversal lasts; assumed


def pitch_regimes(logged: LoggedPitch, radius_m: float) -> dict[str, NDArray[np.bool_]]:
    """Return masks (n,) by the words that a report uses."""
    n = len(logged)
    rate = np.nan_to_num(logged.gyro_rad_s)
    if not rate.any():
        rate = np.gradient(np.nan_to_num(logged.theta_rad)) * logged.rate_Hz
    width = max(1, round(0.05 * logged.rate_Hz))
    calm = np.convolve(rate, np.ones(width) / width, mode="same")
    slow = np.abs(calm) < SLOW_RAD_S
    turns = np.zeros(n, bool)
    turns[1:] = np.sign(calm[1:]) != np.sign(calm[:-1])
    near_turn = (
        np.convolve(turns, np.ones(2 * round(REVERSAL_WINDOW_S * logged.rate_Hz) + 1), "same") > 0
    )
    mean = logged.pwm_us.mean(axis=0)
    step = np.abs(np.gradient(logged.pwm_us[0] - logged.pwm_us[-1]))
    settled = np.convolve(step, np.ones(width) / width, "same") < np.median(step) + 1e-9
    low, high = np.quantile(mean, [1.0 / 3.0, 2.0 / 3.0])
    covered = logged.plate_share > 0.0
    near = covered & (logged.plate_z_m < NEAR_Z_OVER_R * radius_m)
    time = np.arange(n)
    out = {
        f"z/R below {NEAR_Z_OVER_R:g}": near,
        "plate in": covered,
        "plate parked": ~covered,
        "slow reversals": slow & near_turn,
        "at rest": slow & ~near_turn,
        "fast motion": np.abs(calm) > np.quantile(np.abs(calm), 0.8),
        LATE: time > 2 * n // 3,
        EARLY: time < n // 3,
        "quick changes of the pulses": ~settled,
    }
    if high - low > 0.05 * (high - 1000.0):
        out |= {"high collective": mean >= high, "low collective": mean <= low}
    return {name: mask for name, mask in out.items() if 0.01 * n < mask.sum() < 0.95 * n}
