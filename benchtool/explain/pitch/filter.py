"""Steady-state Kalman filter of a pitch log, from the stated noise alone.

State: pitch, rate, and the wake's torque as an Ornstein-Uhlenbeck process. The noise is that of the
bench (data sheets, a hover-hold record), not of the residuals under test, so that the disturbance
cannot absorb a slow effect such as a centre-of-gravity offset.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, solve_discrete_are
from scipy.signal import lfilter, ss2tf

from benchtool.core.units import Array
from benchtool.explain.engine.evidence import HALF_Z_OVER_R, WITHIN
from benchtool.explain.pitch.resampling import find_segments
from benchtool.physics.images import height_over
from benchtool.physics.model import Model
from benchtool.simulate.pitch.bench import PitchBench, PitchSensor
from benchtool.simulate.pitch.filter_log import LoggedPitch
from benchtool.simulate.pitch.lane import plane_below

CHANNELS = ("theta_rad", "gyro_rad_s", "rpm")

MIN_WAKE_TORQUE = 1e-3  # sd of the wake's torque over m g L where none is stated; assumed
DEFAULT_CORRELATION_S = 0.1  # of the wake's torque where none is stated; assumed

# Share of a speed error corrected by each reading: errors decay in some 50 readings. Larger gains
# feed reading noise through the lag, which biases its estimate: 20 ms became 16 ms at 0.1.
SPEED_GAIN = 0.02

SETTLING_S = 0.3  # after a restart of the filter, before its innovations are used
PIECE = 40_000  # rows filtered at once; memory is proportional to it

# Correlation lengths: log of the distance, share of the duration.
DISTANCE, TIME = 0.5, 0.25
COVERED_DISC = 0  # index of the disc over the plate, as of `PitchBench.from_model`
MIN_Z_OVER_R = 0.1  # lower limit of z/R; assumed
STICTION_RAD_S = 0.01  # smaller rates are not resolved: 0.6 deg/s; assumed
AVERAGING_S = 0.02  # window of angle and rate before a row
ErrorChannel = Literal["torque", "pitch", "gyro", "speed"]
RECORDING_GAP = 100.0  # between recordings, in correlation lengths: independent functions
MAX_BLOCK_SIZE = 1_000_000  # numbers filtered at once: half an hour in 100 MB


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PitchFilter:
    """Gains of a filter and statistics of its innovations."""

    gains: Array  # (7,) in the order of `simulate.pitch.lane.FilterGains`
    whitener: Array  # (2, 2) from innovations of pitch and gyro to unit white noise
    reading_sd: Mapping[str, float]  # standard deviation by channel: rad, rad/s, speeds in rad/s
    state_root: Array  # (3, 3) root of the covariance of pitch, rate, wake torque after a reading
    step: Array  # (3, 3) transition matrix of pitch, rate and wake torque over one row


@dataclass(frozen=True, eq=False, kw_only=True)
class FilteredLog:
    """Recording with its filter, its valid rows, and the innovations of errors outside all laws.

    The filter has constant gains, so its innovations are linear in any error that it does not
    model.
    """

    logged: LoggedPitch
    model: Model
    index: int  # of the recording
    filter: PitchFilter
    indices: NDArray[np.intp]  # (n_rows * n_averaged,) rows with settled innovations
    n_averaged: int  # indices averaged into one row of evidence
    has_gyro: bool
    has_speed: tuple[bool, ...]

    @classmethod
    def of(cls, logged: LoggedPitch, model: Model, index: int, n_averaged: int) -> FilteredLog:
        """Return a recording with the steady-state filter of its model."""
        filter_ = pitch_filter(
            PitchBench.from_model(model),
            logged.rate_Hz,
            gyro=bool(np.isfinite(logged.gyro_rad_s).any()),
            speeds=bool(np.isfinite(logged.speed_rad_s).any()),
        )
        valid = np.ones(len(logged), bool)
        n_settling = round(SETTLING_S * logged.rate_Hz)
        for segment in find_segments(logged.mode):
            valid[segment.start : segment.start + n_settling] = False
        indices = [i + np.flatnonzero(valid[i : i + PIECE]) for i in range(0, len(valid), PIECE)]
        blocks = [part[: len(part) // n_averaged * n_averaged] for part in indices]
        return cls(
            logged=logged,
            model=model,
            index=index,
            filter=filter_,
            indices=np.concatenate(blocks),
            n_averaged=n_averaged,
            has_gyro=bool(np.isfinite(logged.gyro_rad_s[valid]).any()),
            has_speed=tuple(
                bool(np.isfinite(readings[valid]).any()) for readings in logged.speed_rad_s
            ),
        )

    @property
    def selected(self) -> NDArray[np.intp] | slice:
        """The indices, as a slice if they are consecutive: four times faster, without a copy."""
        if len(self.indices) and np.ptp(self.indices) == len(self.indices) - 1:
            return slice(self.indices[0], self.indices[-1] + 1)
        return self.indices

    @property
    def n_rows(self) -> int:
        """Number of rows of evidence per channel."""
        return len(self.indices) // self.n_averaged

    def average(self, values: Array) -> Array:
        """Return values (n, ...) averaged over each row of evidence (n_rows, ...)."""
        return self._average(np.asarray(values[self.indices], float))

    def _average(self, rows: Array) -> Array:
        if self.n_averaged == 1:
            return rows
        return np.asarray(rows.reshape(self.n_rows, self.n_averaged, *rows.shape[1:]).mean(axis=1))

    @property
    def n_channels(self) -> int:
        """Number of channels with rows."""
        return 1 + self.has_gyro + sum(self.has_speed)

    def whiten(self, errors: Sequence[Array] | Array, whitened: Array) -> None:
        """Write errors (n_indices, r) of pitch, gyro and speeds as (n_channels, n_rows, r)."""
        whitener, pitch = self.filter.whitener, _without_nan(errors[0])
        rows = [whitener[0, 0] * pitch]
        if self.has_gyro:  # empty rows would lower the estimated noise
            rows.append(_without_nan(whitener[1, 0] * pitch + whitener[1, 1] * errors[1]))
        speeds = zip(self.has_speed, self.logged.speed_rad_s, errors[2:], strict=True)
        for has_readings, readings, error in speeds:
            if has_readings:
                error[~np.isfinite(readings[self.indices])] = 0.0
                rows.append(error / self.filter.reading_sd["rpm"])
        for row, whitened_row in zip(rows, whitened, strict=True):
            np.multiply(np.sqrt(self.n_averaged), self._average(row), out=whitened_row)

    def pieces(self) -> Iterator[FilteredLog]:
        """Yield pieces; each begins before its rows of evidence, for the filter to settle."""
        lead = round(SETTLING_S * self.logged.rate_Hz)
        for first in range(0, len(self.logged), PIECE):
            start, stop = max(first - lead, 0), min(first + PIECE, len(self.logged))
            indices = self.indices[(self.indices >= first) & (self.indices < stop)] - start
            yield replace(self, logged=self.logged.between(start, stop), indices=indices)

    @cached_property
    def speed(self) -> Array:
        """Speeds of the discs (discs, n): rad/s; from pulses where not measured."""
        p = self.model.rig.propulsion
        logged = self.logged
        steady_speed = p.speed_per_us_rad_s * np.maximum(logged.pwm_us - p.pwm_start_us, 0.0)
        return np.where(np.isfinite(logged.speed_rad_s), logged.speed_rad_s, steady_speed)

    @cached_property
    def thrust(self) -> Array:
        """Thrusts of the discs out of ground effect (discs, n): N."""
        return np.asarray(self.model.rig.propulsion.thrust_coefficient_N_s2 * self.speed**2, float)

    @cached_property
    def rate(self) -> Array:
        """Rate of the beam (n,): rad/s."""
        gyro_rad_s = np.nan_to_num(self.logged.gyro_rad_s)
        theta_rad = np.nan_to_num(self.logged.theta_rad)
        return gyro_rad_s if gyro_rad_s.any() else np.gradient(theta_rad) * self.logged.rate_Hz

    def values(self, variable: str) -> Array:
        """Return a variable (n,), nan where undefined.

        Time and distance are in correlation lengths; other variables have `LENGTH` of their range.
        """
        logged = self.logged
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
        plane = plane_below(self.logged.plate_z_m, self.values("angle"), 0.0)
        x_m, y_m = self.model.rig.disc_positions_m[COVERED_DISC, :2]
        return np.asarray(height_over(plane, x_m, y_m), float)

    def error_rows(self, channel: ErrorChannel, errors: Array) -> Array:
        """Return whitened rows (n_rows, r) of errors (n, r).

        Errors of a torque in N m, of a reading, or of the speeds as a share of them.
        """
        rows = np.empty((self.n_channels, self.n_rows, errors.shape[1]))
        n_blocks = 1 + errors.size // MAX_BLOCK_SIZE
        blocks = (np.array_split(array, n_blocks, axis=-1) for array in (errors, rows))
        for block, whitened in zip(*blocks, strict=True):
            self.whiten(self._innovations(channel, block)[:, self.indices], whitened)
        return rows.reshape(-1, errors.shape[1])

    def whitened_rows(self, name: str, basis: Array) -> tuple[Array, Array]:
        """Return whitened rows and shares of readings (n_rows, r) of smooth functions (n, r)."""
        channel, _, variable = name.partition(": ")
        limits = self.model.discrepancy
        if channel == "torque":
            arms_m, thrust_N = np.abs(self.model.rig.disc_positions_m[:, 0]), self.thrust
            if variable == "distance":
                ratio = self.height_m / self.model.rig.propulsion.radius_m / HALF_Z_OVER_R
                weight = self.logged.plate_share / (1.0 + ratio**2)
                basis = weight[:, None] * basis
                arms_m, thrust_N = arms_m[[COVERED_DISC]], thrust_N[[COVERED_DISC]]
            tolerance = limits.thrust if variable == "distance" else limits.torque
            share = WITHIN * tolerance * basis
            rows = self.error_rows("torque", (arms_m @ thrust_N)[:, None] * share)
        elif channel == "speed":
            share = WITHIN * limits.speed * basis
            rows = self.error_rows("speed", share)
        else:
            is_angle = variable == "angle"
            typical = float(np.std(self.values("angle") if is_angle else self.rate))
            error = WITHIN * (limits.encoder_rad if is_angle else limits.gyro * typical) * basis
            share = error / typical
            rows = self.error_rows("pitch" if is_angle else "gyro", error)
        channels = rows.reshape(-1, self.n_rows, rows.shape[1])
        is_affected = np.asarray(channels.any(axis=(1, 2)))[:, None, None]
        return rows, (is_affected * self.average(share)).reshape(rows.shape)

    def _innovations(self, channel: ErrorChannel, errors: Array) -> Array:
        """Return innovations (2 + n_discs, n, r); those of angle and rate restart in a segment."""
        innovations = np.zeros((2 + len(self.speed), *errors.shape))
        dt, step, measured = 1.0 / self.logged.rate_Hz, self.filter.step, np.eye(3)[:2]
        gain = self.filter.gains[:6].reshape(3, 2)
        if channel == "speed":
            decay = np.exp(-1.0 / (self.model.rig.propulsion.lag_s * self.logged.rate_Hz))
            lag = [0.0, 1.0 - decay], [1.0, -decay * (1.0 - self.filter.gains[6])]
            innovations[2:] = lfilter(*lag, self.speed[:, :, None] * errors, axis=1)
            return innovations
        if channel == "torque":
            feedthrough = np.zeros((2, 1))
            input_gain = np.array([[dt**2 / 2.0], [dt], [0.0]])
            input_gain /= self.model.rig.body.inertia_yy_kgm2
        else:
            feedthrough = np.array([[channel == "pitch"], [channel == "gyro"]], float)
            input_gain = -step @ gain @ feedthrough
        rows, denominator = ss2tf(
            step @ (np.eye(3) - gain @ measured), input_gain, measured, feedthrough
        )
        for part in find_segments(self.logged.mode):
            for index, row in enumerate(rows):
                innovations[index, part] = lfilter(row, denominator, errors[part], axis=0)
        return innovations


def _without_nan(values: Array) -> Array:
    """Return values with nan replaced by 0 and infinity by the largest number."""
    return values if np.isfinite(values).all() else np.nan_to_num(values)


def pitch_filter(bench: PitchBench, rate_Hz: float, *, gyro: bool, speeds: bool) -> PitchFilter:
    """Return the steady-state filter of a bench at the rate of its log."""
    dt_s = 1.0 / rate_Hz
    sensors = {name: bench.sensors.get(name, PitchSensor()) for name in CHANNELS}
    reading_sd = {  # quantum included; at least 1e-6
        name: float(max(np.hypot(sensor.noise, sensor.quantum / np.sqrt(12.0)), 1e-6))
        for name, sensor in sensors.items()
    }
    theta_sd, gyro_sd = reading_sd["theta_rad"], reading_sd["gyro_rad_s"]
    rig = bench.model.rig
    arm_m = float(np.max(np.abs(rig.disc_positions_m[:, 0])))
    min_Nm = MIN_WAKE_TORQUE * rig.body.mass_kg * 9.81 * arm_m
    wake_Nm, correlation_s = bench.model.random_torque or (min_Nm, DEFAULT_CORRELATION_S)
    a = np.array(
        [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0 / bench.inertia_kgm2], [0.0, 0.0, -1.0 / correlation_s]]
    )
    process_noise = np.zeros((3, 3))
    process_noise[2, 2] = 2.0 * wake_Nm**2 / correlation_s
    # Van Loan 1978: transition and noise of one tick from one matrix exponential.
    exponential = expm(np.block([[-a, process_noise], [np.zeros((3, 3)), a.T]]) * dt_s)
    step = exponential[3:, 3:].T
    noise = step @ exponential[:3, 3:]
    measurement = np.eye(3)[:2] if gyro else np.eye(3)[:1]
    reading_noise = np.diag([theta_sd**2, gyro_sd**2])[: len(measurement), : len(measurement)]
    scale = np.diag([theta_sd, gyro_sd, wake_Nm])  # for a well-conditioned equation
    inverse = np.linalg.inv(scale)
    covariance = scale @ solve_discrete_are(
        (inverse @ step @ scale).T,
        (measurement @ scale).T,
        inverse @ noise @ inverse,
        reading_noise,
    ) @ scale  # fmt: skip
    innovation = measurement @ covariance @ measurement.T + reading_noise
    gain = covariance @ measurement.T @ np.linalg.inv(innovation)
    updated = covariance - gain @ measurement @ covariance
    gains = np.zeros((3, 2))
    gains[:, : len(measurement)] = gain
    whitener = np.eye(2)
    whitener[: len(measurement), : len(measurement)] = np.linalg.inv(np.linalg.cholesky(innovation))
    return PitchFilter(
        gains=np.append(gains.ravel(), SPEED_GAIN if speeds else 0.0),
        whitener=whitener,
        reading_sd=reading_sd,
        step=step,
        state_root=np.asarray(
            np.linalg.cholesky(0.5 * (updated + updated.T) + 1e-16 * scale @ scale), float
        ),
    )
