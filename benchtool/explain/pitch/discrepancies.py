"""Discrepancies of pitch recordings: torques, speeds and reading errors outside all laws.

Each is a smooth function of one variable, of the size of its tolerance. The filter has constant
gains, so its innovations are linear in any error that it does not model.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.signal import lfilter, ss2tf

from benchtool.core.units import Array
from benchtool.explain.engine.evidence import HALF_Z_OVER_R, WITHIN, Discrepancy, smooth_root
from benchtool.explain.pitch.filter import FilterResult
from benchtool.explain.pitch.resampling import find_segments
from benchtool.physics.images import height_over
from benchtool.physics.model import Model
from benchtool.simulate.pitch.lane import plane_below

# Correlation lengths: share of the range, log of the distance, share of the duration.
LENGTH, DISTANCE, TIME = 0.3, 0.5, 0.25

COVERED_DISC = 0  # index of the disc over the plate, as of `PitchBench.from_model`
MIN_Z_OVER_R = 0.1  # lower limit of z/R; assumed
STICTION_RAD_S = 0.01  # smaller rates are not resolved: 0.6 deg/s; assumed
AVERAGING_S = 0.02  # window of angle and rate before a row
RECORDING_GAP = 100.0  # between recordings, in correlation lengths: independent functions
RESOLUTION = 0.05  # of positions, in correlation lengths
MAX_BLOCK_SIZE = 1_000_000  # numbers filtered at once: half an hour in 100 MB

VARIABLES = {  # variables of each kind of discrepancy
    "torque": ("angle", "rate", "thrust", "time", "distance"),
    "speed": ("pulse", "time", "distance"),
    "reading": ("angle", "rate"),
}


@dataclass(frozen=True, eq=False)
class DiscrepancySimulation:
    """Variables of discrepancies in one recording, and their innovations."""

    log: FilterResult
    model: Model
    index: int  # of the recording

    @cached_property
    def speed(self) -> Array:
        """Speeds of the discs (discs, n): rad/s; from pulses where not measured."""
        p = self.model.rig.propulsion
        logged = self.log.logged
        steady_speed = p.speed_per_us_rad_s * np.maximum(logged.pwm_us - p.pwm_start_us, 0.0)
        return np.where(np.isfinite(logged.speed_rad_s), logged.speed_rad_s, steady_speed)

    @cached_property
    def thrust(self) -> Array:
        """Thrusts of the discs out of ground effect (discs, n): N."""
        return np.asarray(self.model.rig.propulsion.thrust_coefficient_N_s2 * self.speed**2, float)

    @cached_property
    def rate(self) -> Array:
        """Rate of the beam (n,): rad/s."""
        gyro_rad_s = np.nan_to_num(self.log.logged.gyro_rad_s)
        theta_rad = np.nan_to_num(self.log.logged.theta_rad)
        return gyro_rad_s if gyro_rad_s.any() else np.gradient(theta_rad) * self.log.logged.rate_Hz

    def values(self, variable: str) -> Array:
        """Return a variable (n,), nan where undefined.

        Time and distance are in correlation lengths; other variables have `LENGTH` of their range.
        """
        logged = self.log.logged
        rows = round(AVERAGING_S * logged.rate_Hz)
        if variable in ("angle", "rate"):
            values = np.nan_to_num(logged.theta_rad) if variable == "angle" else self.rate
            # The mean of the previous rows is independent of a row's noise.
            sums = np.cumsum(np.concatenate([np.full(rows + 1, values[0]), values]))
            return np.asarray((sums[rows:-1] - sums[: -rows - 1]) / rows, float)
        if variable == "slowness":  # friction laws differ most at low rates
            return np.log(np.maximum(np.abs(self.values("rate")), STICTION_RAD_S))
        if variable == "thrust":
            return np.asarray(self.thrust.sum(axis=0), float)
        if variable == "pulse":
            return np.asarray(logged.pwm_us.mean(axis=0), float)
        if variable == "time":
            return RECORDING_GAP * self.index + np.arange(len(logged)) / len(logged) / TIME
        ratio = np.maximum(self.height_m / self.model.rig.propulsion.radius_m, MIN_Z_OVER_R)
        return np.where(logged.plate_share > 0.0, np.log(ratio) / DISTANCE, np.nan)

    @cached_property
    def height_m(self) -> Array:
        """Distance from the covered disc to the plate (n,), with the beam tilted: m."""
        plane = plane_below(self.log.logged.plate_z_m, self.values("angle"), 0.0)
        x_m, y_m = self.model.rig.disc_positions_m[COVERED_DISC, :2]
        return np.asarray(height_over(plane, x_m, y_m), float)

    def rows(self, channel: Literal["torque", "pitch", "gyro"], errors: Array) -> Array:
        """Return whitened rows (n_rows, r) of torques in N m or reading errors (n, r)."""
        parts = []
        for block in np.array_split(errors, 1 + errors.size // MAX_BLOCK_SIZE, axis=1):
            innovations = np.zeros((2 + len(self.speed), *block.shape))
            if channel == "torque":
                innovations[:2] = self.torque_innovations(block)
            else:
                innovations[:2] = self.reading_innovations(int(channel == "gyro"), block)
            parts.append(self.whiten(innovations))
        return np.hstack(parts)

    def innovations(self, name: str, basis: Array) -> tuple[Array, Array]:
        """Return innovations (2 + discs, n, r) and shares (n, r) of smooth functions (n, r)."""
        channel, _, variable = name.partition(": ")
        limits = self.model.discrepancy
        innovations = np.zeros((2 + len(self.speed), *basis.shape))
        if channel == "torque":
            arms_m, thrust_N = np.abs(self.model.rig.disc_positions_m[:, 0]), self.thrust
            if variable == "distance":
                ratio = self.height_m / self.model.rig.propulsion.radius_m / HALF_Z_OVER_R
                weight = self.log.logged.plate_share / (1.0 + ratio**2)
                basis = weight[:, None] * basis
                arms_m, thrust_N = arms_m[[COVERED_DISC]], thrust_N[[COVERED_DISC]]
            tolerance = limits.thrust if variable == "distance" else limits.torque
            share = WITHIN * tolerance * basis
            innovations[:2] = self.torque_innovations((arms_m @ thrust_N)[:, None] * share)
        elif channel == "speed":
            share = WITHIN * limits.speed * basis
            rate_Hz = self.log.logged.rate_Hz
            decay = np.exp(-1.0 / (self.model.rig.propulsion.lag_s * rate_Hz))
            lag = [0.0, 1.0 - decay], [1.0, -decay * (1.0 - self.log.filter.gains[6])]
            innovations[2:] = lfilter(*lag, self.speed[:, :, None] * share, axis=1)
        else:
            encoder, gyro = (0, np.std(self.values("angle"))), (1, np.std(self.rate))
            row, typical = encoder if variable == "angle" else gyro
            size = limits.encoder_rad if variable == "angle" else limits.gyro * float(typical)
            error = WITHIN * size * basis
            share = error / float(typical)
            innovations[:2] = self.reading_innovations(row, error)
        return innovations, share

    def whitened_rows(self, name: str, basis: Array) -> tuple[Array, Array]:
        """Return whitened rows and shares of readings (n_rows, r) of smooth functions (n, r)."""
        innovations, share = self.innovations(name, basis)
        rows = self.whiten(innovations)
        channels = rows.reshape(-1, self.log.n_rows, rows.shape[1])
        is_affected = np.asarray(channels.any(axis=(1, 2)))[:, None, None]
        return rows, (is_affected * self.log.rows(share)).reshape(rows.shape)

    def whiten(self, innovations: Array) -> Array:
        """Return innovations (2 + discs, n, r) as rows (n_rows, r)."""
        return np.concatenate(self.log.whiten(innovations))

    def torque_innovations(self, torque: Array) -> Array:
        """Return innovations (2, n, r) of unmodelled torques (n, r) in N m."""
        dt = 1.0 / self.log.logged.rate_Hz
        torque_input = np.array([[dt**2 / 2.0], [dt], [0.0]]) / self.model.rig.body.inertia_yy_kgm2
        return self._run(torque_input, np.zeros((2, 1)), torque)

    def reading_innovations(self, row: int, error: Array) -> Array:
        """Return innovations (2, n, r) of errors (n, r) in a reading: pitch 0, gyro 1."""
        filter_, feedthrough = self.log.filter, np.eye(2)[:, row : row + 1]
        gain = filter_.gains[:6].reshape(3, 2)
        return self._run(-filter_.step @ gain @ feedthrough, feedthrough, error)

    def _run(self, input_gain: Array, feedthrough: Array, values: Array) -> Array:
        """Return the filter's response (2, n, r) to an input, restarted in each segment."""
        filter_, measured = self.log.filter, np.eye(3)[:2]
        segments = find_segments(self.log.logged.mode)
        closed = filter_.step @ (np.eye(3) - filter_.gains[:6].reshape(3, 2) @ measured)
        rows, denominator = ss2tf(closed, input_gain, measured, feedthrough)
        return np.array(
            [
                np.concatenate(
                    [lfilter(row, denominator, values[part], axis=0) for part in segments]
                )
                for row in rows
            ]
        )


def discrepancies(logs: Sequence[DiscrepancySimulation]) -> Iterator[Discrepancy]:
    """Yield the discrepancies of recordings, their rows concatenated."""
    for channel, variables in VARIABLES.items():
        for variable in variables:
            if (bases := smooth(logs, variable)) is None:
                continue
            name = f"{channel}: {variable}"
            columns, shares = [], []
            for log, basis in zip(logs, bases, strict=True):
                n_blocks = min(basis.shape[1], 1 + basis.size // MAX_BLOCK_SIZE)
                blocks = np.array_split(basis, n_blocks, axis=1)
                pieces = [log.whitened_rows(name, block) for block in blocks]
                columns.append(np.hstack([rows for rows, _ in pieces]))
                shares.append(np.hstack([share for _, share in pieces]))
            rows = np.concatenate(columns)
            if rows.any():
                yield Discrepancy(
                    name=name,
                    columns=rows,
                    shares=np.concatenate(shares),
                )


def smooth(logs: Sequence[DiscrepancySimulation], variable: str) -> list[Array] | None:
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
