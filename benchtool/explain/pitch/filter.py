"""Steady-state Kalman filter of a pitch log, from the stated noise alone.

State: pitch, rate, and the wake's torque as an Ornstein-Uhlenbeck process. The noise is that of the
bench (data sheets, a hover-hold record), not of the residuals under test, so that the disturbance
cannot absorb a slow effect such as a centre-of-gravity offset.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, solve_discrete_are

from benchtool.core.units import Array
from benchtool.simulate.pitch.bench import PitchBench, PitchSensor
from benchtool.simulate.pitch.filter_log import LoggedPitch

CHANNELS = ("theta_rad", "gyro_rad_s", "rpm")

MIN_WAKE_TORQUE = 1e-3  # sd of the wake's torque over m g L where none is stated; assumed
DEFAULT_CORRELATION_S = 0.1  # of the wake's torque where none is stated; assumed

# Share of a speed error corrected by each reading: errors decay in some 50 readings. Larger gains
# feed reading noise through the lag, which biases its estimate: 20 ms became 16 ms at 0.1.
SPEED_GAIN = 0.02

PIECE = 40_000  # rows filtered at once; memory is proportional to it


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PitchFilter:
    """Gains of a filter and statistics of its innovations."""

    gains: Array  # (7,) in the order of `simulate.pitch.lane.FilterGains`
    whitener: Array  # (2, 2) from innovations of pitch and gyro to unit white noise
    reading_sd: Mapping[str, float]  # standard deviation by channel: rad, rad/s, speeds in rad/s
    state_root: Array  # (3, 3) root of the covariance of pitch, rate, wake torque after a reading
    step: Array  # (3, 3) transition matrix of pitch, rate and wake torque over one row


@dataclass(frozen=True, slots=True, eq=False)
class FilterResult:
    """Recording with its filter and its valid rows."""

    logged: LoggedPitch
    filter: PitchFilter
    indices: NDArray[np.intp]  # (n_rows * n_averaged,) rows with settled innovations
    n_averaged: int  # indices averaged into one row of evidence
    has_gyro: bool
    has_speed: tuple[bool, ...]

    @classmethod
    def of(
        cls, logged: LoggedPitch, filter_: PitchFilter, valid: NDArray[np.bool_], n_averaged: int
    ) -> FilterResult:
        """Return the result with the rows of the mask `valid` (n,) as evidence."""
        indices = [i + np.flatnonzero(valid[i : i + PIECE]) for i in range(0, len(valid), PIECE)]
        blocks = [part[: len(part) // n_averaged * n_averaged] for part in indices]
        return cls(
            logged=logged,
            filter=filter_,
            indices=np.concatenate(blocks),
            n_averaged=n_averaged,
            has_gyro=bool(np.isfinite(logged.gyro_rad_s[valid]).any()),
            has_speed=tuple(
                bool(np.isfinite(readings[valid]).any()) for readings in logged.speed_rad_s
            ),
        )

    @property
    def n_rows(self) -> int:
        """Number of rows of evidence per channel."""
        return len(self.indices) // self.n_averaged

    def rows(self, values: Array) -> Array:
        """Return values (n, ...) averaged over each row of evidence (n_rows, ...)."""
        rows = np.asarray(values[self.indices], float)
        if self.n_averaged == 1:
            return rows
        return np.asarray(rows.reshape(self.n_rows, self.n_averaged, *rows.shape[1:]).mean(axis=1))

    @property
    def n_channels(self) -> int:
        """Number of channels with rows."""
        return 1 + self.has_gyro + sum(self.has_speed)

    def whiten(self, errors: Sequence[Array] | Array) -> tuple[Array, ...]:
        """Return errors (n, r) of pitch, gyro and each disc's speed as whitened rows."""
        whitener = self.filter.whitener
        pitch = np.nan_to_num(errors[0])
        rows = [whitener[0, 0] * pitch]
        if self.has_gyro:  # empty rows would lower the estimated noise
            rows.append(np.nan_to_num(whitener[1, 0] * pitch + whitener[1, 1] * errors[1]))
        speeds = zip(self.has_speed, self.logged.speed_rad_s, errors[2:], strict=True)
        for has_readings, readings, error in speeds:
            if has_readings:
                is_finite = np.isfinite(readings)[:, None]
                rows.append(np.where(is_finite, error, 0.0) / self.filter.reading_sd["rpm"])
        return tuple(np.sqrt(self.n_averaged) * self.rows(row) for row in rows)

    def pieces(self, lead: int) -> Iterator[tuple[FilterResult, float]]:
        """Yield pieces of the recording, each with the time of its first row: s.

        Each begins `lead` rows before its rows of evidence, for the filter to settle.
        """
        for first in range(0, len(self.logged), PIECE):
            start, stop = max(first - lead, 0), min(first + PIECE, len(self.logged))
            indices = self.indices[(self.indices >= first) & (self.indices < stop)] - start
            part = replace(self, logged=self.logged.between(start, stop), indices=indices)
            yield part, start / self.logged.rate_Hz


def pitch_filter(bench: PitchBench, rate_Hz: float, *, gyro: bool, speeds: bool) -> PitchFilter:
    """Return the steady-state filter of a bench at the rate of its log."""
    dt_s = 1.0 / rate_Hz
    reading_sd = {name: _reading_sd(bench.sensors.get(name, PitchSensor())) for name in CHANNELS}
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


def _reading_sd(sensor: PitchSensor) -> float:
    """Return the standard deviation of one reading including its quantum; at least 1e-6."""
    return float(max(np.hypot(sensor.noise, sensor.quantum / np.sqrt(12.0)), 1e-6))
