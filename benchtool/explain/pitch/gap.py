"""Gap between recording and open-loop prediction over windows, and its noise floor.

Each window starts from the filter's state estimate from earlier samples only. The floor is the
prediction error of a true model: from the covariance of the initial state, the stated wake torque
and the stated sensor noise, independent of the residuals.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.explain.pitch.evidence import SETTLING_S
from benchtool.explain.pitch.filter import FilterResult, reading_sd
from benchtool.simulate.pitch import filter_ticks as t
from benchtool.simulate.pitch.bench import PitchBench, PitchSensor, rig_sensors
from benchtool.simulate.pitch.filter_log import (
    LoggedPitch,
    Predictions,
    filter_log,
    predict_windows,
)

UNITS = {"theta_rad": "rad", "gyro_rad_s": "rad/s", "rpm": "rpm"}  # channels of a gap

RPM = 30.0 / np.pi

LEAD_S = 0.1  # pulses before a window that a delay needs
MAX_LANES = 32  # true models simulated at once
MAX_BLOCK_SIZE = 2_000_000  # rows times lanes predicted at once: two minutes at 250 Hz
OVERLAP = 2  # half-overlapping windows; the mean is nearly as precise as with 1.5 times as many
BLOCK_S = 1.0  # of reported errors; longer than the correlation of windows and wake


def read_channels(logged: LoggedPitch) -> dict[str, Array]:
    """Return readings (n,), speeds (n, n_discs), by channel in its unit."""
    rpm = RPM * logged.speed_rad_s.T
    return {"theta_rad": logged.theta_rad, "gyro_rad_s": logged.gyro_rad_s, "rpm": rpm}


def predicted_channels(run: Predictions) -> dict[str, Array]:
    """Return predictions (n, lanes), speeds (n, n_discs, lanes), by channel in its unit."""
    return {"theta_rad": run.theta_rad, "gyro_rad_s": run.gyro_rad_s, "rpm": RPM * run.speed_rad_s}


def sensor_sds(bench: PitchBench) -> dict[str, float]:
    """Return the standard deviation of a reading by channel: rad, rad/s, speeds in rad/s."""
    sensors = rig_sensors(bench.model.rig)
    return {name: reading_sd(sensors.get(name, PitchSensor())) for name in UNITS}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Windows:
    """Windows of a log without dropouts, after the filter has settled."""

    log: FilterResult  # the recording with its filter
    starts: NDArray[np.intp]  # (w,) first rows
    rows: int  # rows of a window
    block: int  # consecutive windows in a block

    @classmethod
    def of(cls, log: FilterResult, window_s: float, overlap: int = 1) -> Windows:
        """Return windows of a length; each begins after 1/`overlap` of the previous one."""
        logged = log.logged
        rows = max(2, round(window_s * logged.rate_Hz))
        hop = max(1, rows // overlap)
        n_settling = round(SETTLING_S * logged.rate_Hz)
        edges = [0, *np.flatnonzero(logged.mode == t.RESTART), len(logged)]
        starts = {
            start
            for first, last in pairwise(edges)
            for start in range(first + n_settling, last - rows + 1, hop)
        }
        block = max(1, round(BLOCK_S * logged.rate_Hz / hop))
        return cls(log=log, starts=np.array(sorted(starts), np.intp), rows=rows, block=block)

    def predicted(self, benches: Sequence[PitchBench]) -> list[Predictions]:
        """Return predictions of each bench (lane) in each window, from its state estimate."""
        return self._run(benches, slice(None), self._states(benches))

    def errors(self, benches: Sequence[PitchBench]) -> dict[str, Array]:
        """Return mean squared errors of each block (b, lanes) by channel."""
        errors: dict[str, list[Array]] = {name: [] for name in UNITS}
        readings, states = read_channels(self.log.logged), self._states(benches)
        for part in self._parts(len(benches)):
            runs = self._run(benches, part, states[part])
            for start, run in zip(self.starts[part], runs, strict=True):
                for name, values in predicted_channels(run).items():
                    error = readings[name][start : start + self.rows, ..., None] - values
                    if np.isfinite(error).any():
                        errors[name].append(np.nanmean(error**2, axis=tuple(range(error.ndim - 1))))
        return {name: self._in_blocks(np.array(s)) for name, s in errors.items() if s}

    def _in_blocks(self, squares: Array) -> Array:
        """Return means of blocks of windows; the last block includes the remaining windows."""
        firsts = self.block * np.arange(max(1, len(squares) // self.block))
        sizes = np.diff([*firsts, len(squares)])
        means: Array = np.add.reduceat(squares, firsts) / sizes[:, None]
        return means

    def floor(
        self, bench: PitchBench, truths: Sequence[PitchBench], rng: np.random.Generator
    ) -> dict[str, Array]:
        """Return root mean squared errors of a true model (draws,) by channel.

        Args:
            truths: true model of each draw: the model itself, or draws of its parameters.
        """
        states = self._states([bench])
        squares = {name: np.zeros(len(truths)) for name in UNITS}
        for part in self._parts(min(len(truths), MAX_LANES)):
            nominal = self._run([bench], part, states[part])
            for first in range(0, len(truths), MAX_LANES):
                lanes = slice(first, first + MAX_LANES)
                starts = [np.repeat(state, len(truths[lanes]), axis=1) for state in states[part]]
                runs = self._disturbed(truths[lanes], part, starts, rng)
                for name, increments in _squares(runs, nominal, sensor_sds(bench), rng).items():
                    squares[name][lanes] += increments
        return {name: np.sqrt(total / len(self.starts)) for name, total in squares.items()}

    def _parts(self, lanes: int) -> list[slice]:
        """Return the windows in parts that fit in memory."""
        n_windows = max(1, MAX_BLOCK_SIZE // (self.rows * lanes))
        return [slice(first, first + n_windows) for first in range(0, len(self.starts), n_windows)]

    def _states(self, benches: Sequence[PitchBench]) -> list[Array]:
        """Return the filter's predicted state before each window (4 + n_discs, lanes)."""
        run = filter_log(benches, self.log.logged, self.log.filter.gains)
        rows = (run.pitch_rad, run.rate_rad_s, run.wake_Nm, run.deflection)
        speed = run.state_speed_rad_s
        return [np.vstack([*(v[row] for v in rows), speed[row]]) for row in self.starts]

    def _disturbed(
        self,
        benches: Sequence[PitchBench],
        part: slice,
        states: Sequence[Array],
        rng: np.random.Generator,
    ) -> list[Predictions]:
        """Return predictions with wake torque, from states disturbed (in place) by their sd."""
        for state in states:
            state[:3] += self.log.filter.state_root @ rng.standard_normal((3, len(benches)))
        return self._run(benches, part, states, seed=int(rng.integers(2**31)))

    def _run(
        self,
        benches: Sequence[PitchBench],
        part: slice,
        states: Sequence[Array],
        seed: int | None = None,
    ) -> list[Predictions]:
        logged = self.log.logged
        lead = round(LEAD_S * logged.rate_Hz)
        return predict_windows(benches, logged, self.starts[part], self.rows, lead, states, seed)


def _squares(
    runs: Sequence[Predictions],
    nominal_runs: Sequence[Predictions],
    sensor_sd: dict[str, float],
    rng: np.random.Generator,
) -> dict[str, Array]:
    """Return mean squared errors (lanes,) with sensor noise, summed over windows, by channel."""
    total = dict.fromkeys(UNITS, np.zeros(runs[0].theta_rad.shape[-1]))
    for run, nominal in zip(runs, nominal_runs, strict=True):
        expected = predicted_channels(nominal)
        for name, prediction in predicted_channels(run).items():
            noise = sensor_sd[name] * rng.standard_normal(prediction.shape, np.float32)
            scale = RPM if name == "rpm" else 1.0
            error = prediction - expected[name] + scale * noise.astype(float)
            mean = np.mean(error**2, axis=tuple(range(error.ndim - 1)))
            total[name] = total[name] + mean
    return total
