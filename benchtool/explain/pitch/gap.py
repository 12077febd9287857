"""The gap: how far a model's prediction over a window is from a recording, and how far it must be.

Each window starts from a state that the filter estimated from earlier samples only, and runs free.
The floor is what the same prediction would miss if the model were the truth: a start as uncertain
as the filter says, the stated wake torque, the stated sensor noise; never the residual itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array_type import Array
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

LEAD_S = 0.1  # how much of the pulses before a window a delay may still hold
AT_ONCE = 32  # how many truths are simulated together
MOST_NUMBERS = 2_000_000  # rows times lanes predicted at once: two minutes at 250 Hz

OVERLAP = 2
"""A window begins in the middle of the one before: what it misses is then counted twice, which
steadies the mean nearly as much as half as many windows more would."""

BLOCK_S = 1.0  # of reported errors; longer than what windows and wake share


def read_channels(logged: LoggedPitch) -> dict[str, Array]:
    """Return readings (n,) by channel, of speeds (n, n_discs), in the channel's unit."""
    return {
        "theta_rad": logged.theta_rad,
        "gyro_rad_s": logged.gyro_rad_s,
        "rpm": RPM * logged.speed_rad_s.T,
    }


def predicted_channels(run: Predictions) -> dict[str, Array]:
    """Return predictions (n, lanes) by channel, of speeds (n, n_discs, lanes)."""
    return {
        "theta_rad": run.theta_rad,
        "gyro_rad_s": run.gyro_rad_s,
        "rpm": RPM * run.speed_rad_s,
    }


def sensor_sds(bench: PitchBench) -> dict[str, float]:
    """Return the standard deviation of a reading by channel: rad, rad/s, of speeds rad/s."""
    sensors = rig_sensors(bench.model.rig)
    return {name: reading_sd(sensors.get(name, PitchSensor())) for name in UNITS}


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Windows:
    """Cut a log into windows, none across a gap and none before the filter settled."""

    log: FilterResult  # the recording with its filter
    starts: NDArray[np.intp]  # (w,) first rows
    rows: int  # rows of a window
    block: int  # how many windows one after the other make a block

    @classmethod
    def of(cls, log: FilterResult, window_s: float, overlap: int = 1) -> Windows:
        """Return windows of a length; each begins after 1/`overlap` of the one before."""
        logged = log.logged
        rows = max(2, round(window_s * logged.rate_Hz))
        hop = max(1, rows // overlap)
        wait = round(SETTLING_S * logged.rate_Hz)
        edges = [0, *np.flatnonzero(logged.mode == t.RESTART), len(logged)]
        starts = {
            start
            for first, last in pairwise(edges)
            for start in range(first + wait, last - rows + 1, hop)
        }
        block = max(1, round(BLOCK_S * logged.rate_Hz / hop))
        return cls(log=log, starts=np.array(sorted(starts), np.intp), rows=rows, block=block)

    def predicted(self, benches: Sequence[PitchBench]) -> list[Predictions]:
        """Return what each bench (a lane) predicts in each window, from its own estimate on."""
        return self._run(benches, slice(None), self._states(benches))

    def errors(self, benches: Sequence[PitchBench]) -> dict[str, Array]:
        """Return mean squared errors of each block (b, lanes) by channel."""
        out: dict[str, list[Array]] = {name: [] for name in UNITS}
        read, states = read_channels(self.log.logged), self._states(benches)
        for part in self._parts(len(benches)):
            runs = self._run(benches, part, states[part])
            for start, run in zip(self.starts[part], runs, strict=True):
                for name, values in predicted_channels(run).items():
                    error = read[name][start : start + self.rows, ..., None] - values
                    if np.isfinite(error).any():
                        out[name].append(np.nanmean(error**2, axis=tuple(range(error.ndim - 1))))
        return {name: self._in_blocks(np.array(s)) for name, s in out.items() if s}

    def _in_blocks(self, squares: Array) -> Array:
        """Return means of blocks of windows; what is too short for one more joins the last."""
        firsts = self.block * np.arange(max(1, len(squares) // self.block))
        sizes = np.diff([*firsts, len(squares)])
        means: Array = np.add.reduceat(squares, firsts) / sizes[:, None]
        return means

    def floor(
        self, bench: PitchBench, truths: Sequence[PitchBench], rng: np.random.Generator
    ) -> dict[str, Array]:
        """Return root mean squared errors of a true model (draws,) by channel.

        Args:
            truths: what is taken for true, one for each draw of the noise: the model itself, or
                models as far from it as its numbers are uncertain.
        """
        states = self._states([bench])
        squares = {name: np.zeros(len(truths)) for name in UNITS}
        for part in self._parts(min(len(truths), AT_ONCE)):
            quiet = self._run([bench], part, states[part])
            for first in range(0, len(truths), AT_ONCE):
                lanes = slice(first, first + AT_ONCE)
                starts = [np.repeat(one, len(truths[lanes]), axis=1) for one in states[part]]
                runs = self._disturbed(truths[lanes], part, starts, rng)
                for name, more in _squares(runs, quiet, sensor_sds(bench), rng).items():
                    squares[name][lanes] += more
        return {name: np.sqrt(one / len(self.starts)) for name, one in squares.items()}

    def _parts(self, lanes: int) -> list[slice]:
        """Return the windows in parts that fit in memory."""
        many = max(1, MOST_NUMBERS // (self.rows * lanes))
        return [slice(first, first + many) for first in range(0, len(self.starts), many)]

    def _states(self, benches: Sequence[PitchBench]) -> list[Array]:
        """Return what the filter knows before each window (4 + n_discs, lanes).

        The state at a row is that of the row before, run on for one tick: as it was predicted.
        """
        whole = filter_log(benches, self.log.logged, self.log.filter.gains)
        rows = (whole.pitch_rad, whole.rate_rad_s, whole.wake_Nm, whole.bent)
        return [
            np.vstack([*(one[row] for one in rows), whole.state_speed_rad_s[row]])
            for row in self.starts
        ]

    def _disturbed(
        self,
        benches: Sequence[PitchBench],
        part: slice,
        states: Sequence[Array],
        rng: np.random.Generator,
    ) -> list[Predictions]:
        """Run from states as uncertain as the filter says (changed in place), with wake torque."""
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
    quiet: Sequence[Predictions],
    sd: dict[str, float],
    rng: np.random.Generator,
) -> dict[str, Array]:
    """Return the sum over windows of mean squared errors (lanes,) by channel, sensors' noise on."""
    total = dict.fromkeys(UNITS, np.zeros(runs[0].theta_rad.shape[-1]))
    for run, still in zip(runs, quiet, strict=True):
        expected = predicted_channels(still)
        for name, values in predicted_channels(run).items():
            noise = sd[name] * rng.standard_normal(values.shape, np.float32)
            scale = RPM if name == "rpm" else 1.0
            error = values - expected[name] + scale * noise.astype(float)
            mean = np.mean(error**2, axis=tuple(range(error.ndim - 1)))
            total[name] = total[name] + mean
    return total
