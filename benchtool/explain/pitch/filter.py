"""The filter of constant gain that follows a pitch log, worked out from the stated noise alone.

State: pitch, rate, and the wake's torque as an Ornstein-Uhlenbeck process. What it takes for noise
is the bench's own (data sheets, a hover-hold record), never the residual that is being judged; so
a slow effect such as a centre-of-gravity offset cannot hide in the disturbance.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm, solve_discrete_are

from benchtool.core.array_type import Array
from benchtool.simulate.pitch.bench import PitchBench, PitchSensor
from benchtool.simulate.pitch.filter_log import LoggedPitch

MIN_WAKE_TORQUE = 1e-3  # sd of the wake's torque over m g L where none is stated; assumed
USUAL_CORRELATION_S = 0.1  # of the wake's torque where none is stated; assumed

SPEED_GAIN = 0.02
"""How far a reading of rotor speed corrects the speed: what the pulses do wrong is gone from the
thrust after some fifty readings. A larger gain feeds the readings' noise back through the lag, and
the likelihood then prefers a shorter lag that forgets it: at 0.1 a lag of 20 ms seemed to be 16 ms
where little moved."""

PIECE = 40_000  # rows of a recording that are filtered at once; memory goes as their number


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PitchFilter:
    """Hold the gains of a filter and what its innovations should be.

    Attributes:
        state_root: (3, 3) root of the covariance of pitch, rate and wake torque after a reading.
        step: (3, 3) how pitch, rate and wake torque go on from one row to the next.
    """

    gains: Array  # (7,) as `simulate.pitch.filter_ticks` takes them
    whitener: Array  # (2, 2) turns innovations of pitch and gyro into white noise of unit size
    speed_sd_rad_s: float  # standard deviation of the innovation of a rotor speed
    state_root: Array
    step: Array


@dataclass(frozen=True, slots=True, eq=False)
class FilterResult:
    """Hold one recording with what belongs to it.

    Attributes:
        taken: (n_rows * together,) rows whose innovations say something.
        together: so many of those are one row of evidence.
    """

    logged: LoggedPitch
    filter: PitchFilter
    taken: NDArray[np.intp]
    together: int
    has_gyro: bool
    has_speed: tuple[bool, ...]

    @classmethod
    def of(
        cls, logged: LoggedPitch, filter_: PitchFilter, counted: NDArray[np.bool_], together: int
    ) -> FilterResult:
        """Return a recording of which some rows (n,) count."""
        taken = [
            first + np.flatnonzero(counted[first : first + PIECE])
            for first in range(0, len(counted), PIECE)
        ]
        whole = [part[: len(part) // together * together] for part in taken]
        return cls(
            logged=logged,
            filter=filter_,
            taken=np.concatenate(whole),
            together=together,
            has_gyro=bool(np.isfinite(logged.gyro_rad_s[counted]).any()),
            has_speed=tuple(bool(np.isfinite(read[counted]).any()) for read in logged.speed_rad_s),
        )

    @property
    def n_rows(self) -> int:
        """How many rows of evidence a channel has."""
        return len(self.taken) // self.together

    def rows(self, values: Array) -> Array:
        """Return the means (n_rows, ...) of values (n, ...) over what makes a row."""
        taken = np.asarray(values[self.taken], float)
        if self.together == 1:
            return taken
        return np.asarray(taken.reshape(self.n_rows, self.together, *taken.shape[1:]).mean(axis=1))

    def pieces(self, lead: int) -> Iterator[tuple[FilterResult, float]]:
        """Give pieces of the recording, each with the time of its first row: s.

        Each begins so many rows before those of it that count, for a filter to settle.
        """
        for first in range(0, len(self.logged), PIECE):
            start, last = max(first - lead, 0), min(first + PIECE, len(self.logged))
            inside = self.taken[(self.taken >= first) & (self.taken < last)] - start
            part = replace(self, logged=self.logged.between(start, last), taken=inside)
            yield part, start / self.logged.rate_Hz


def pitch_filter(bench: PitchBench, rate_Hz: float, *, gyro: bool, speeds: bool) -> PitchFilter:
    """Return the steady filter of a bench whose log has so many rows a second."""
    dt_s = 1.0 / rate_Hz
    theta_sd, gyro_sd, speed_sd = (
        reading_sd(bench.sensors.get(name, PitchSensor()))
        for name in ("theta_rad", "gyro_rad_s", "rpm")
    )
    wake_Nm, correlation_s = wake_model(bench)
    a = np.array(
        [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0 / bench.inertia_kgm2], [0.0, 0.0, -1.0 / correlation_s]]
    )
    driven = np.zeros((3, 3))
    driven[2, 2] = 2.0 * wake_Nm**2 / correlation_s
    # Van Loan 1978: transition and noise of one tick from one exponential.
    both = expm(np.block([[-a, driven], [np.zeros((3, 3)), a.T]]) * dt_s)
    step = both[3:, 3:].T
    noise = step @ both[:3, 3:]
    seen = np.eye(3)[:2] if gyro else np.eye(3)[:1]
    reading = np.diag([theta_sd**2, gyro_sd**2])[: len(seen), : len(seen)]
    scale = np.diag([theta_sd, gyro_sd, wake_Nm])  # for a well-conditioned equation
    inverse = np.linalg.inv(scale)
    p = scale @ solve_discrete_are(
        (inverse @ step @ scale).T,
        (seen @ scale).T,
        inverse @ noise @ inverse,
        reading,
    ) @ scale  # fmt: skip
    innovation = seen @ p @ seen.T + reading
    gain = p @ seen.T @ np.linalg.inv(innovation)
    after = p - gain @ seen @ p
    gains = np.zeros((3, 2))
    gains[:, : len(seen)] = gain
    whitener = np.eye(2)
    whitener[: len(seen), : len(seen)] = np.linalg.inv(np.linalg.cholesky(innovation))
    return PitchFilter(
        gains=np.append(gains.ravel(), SPEED_GAIN if speeds else 0.0),
        whitener=whitener,
        speed_sd_rad_s=speed_sd,
        step=step,
        state_root=np.asarray(
            np.linalg.cholesky(0.5 * (after + after.T) + 1e-16 * scale @ scale), float
        ),
    )


def reading_sd(sensor: PitchSensor) -> float:
    """Return the standard deviation of one reading, its quantum included; never quite 0."""
    return float(max(np.hypot(sensor.noise, sensor.quantum / np.sqrt(12.0)), 1e-6))


def wake_model(bench: PitchBench) -> tuple[float, float]:
    """Return standard deviation (N m) and correlation time (s) of the wake's torque."""
    rig = bench.model.rig
    arm_m = float(np.max(np.abs(rig.disc_positions_m[:, 0])))
    least = MIN_WAKE_TORQUE * rig.body.mass_kg * 9.81 * arm_m
    return bench.model.random_torque or (least, USUAL_CORRELATION_S)
