"""Pitch recordings as the subject of an explanation.

The gap is the error of open-loop predictions over windows. Each window starts from the filter's
state estimate from earlier samples only. The floor is the prediction error of a true model: from
the covariance of the initial state, the stated wake torque and the stated sensor noise, independent
of the residuals.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from benchtool.core.units import Array
from benchtool.explain.engine.subject import Subject, build_overlay
from benchtool.explain.findings import Overlay
from benchtool.explain.pitch.dependences import summarize_residuals
from benchtool.explain.pitch.evidence import PitchEvidence
from benchtool.explain.pitch.filter import CHANNELS, SETTLING_S, FilteredLog
from benchtool.explain.pitch.log import PitchLog
from benchtool.explain.pitch.next_experiment import PitchDesigner
from benchtool.explain.pitch.resampling import find_segments
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model
from benchtool.simulate.pitch.bench import PitchBench
from benchtool.simulate.pitch.filter_log import (
    LoggedPitch,
    Predictions,
    filter_states,
    predict_windows,
)

RPM = 30.0 / np.pi

LEAD_S = 0.1  # pulses before a window that a delay needs
MAX_LANES = 32  # true models simulated at once
MAX_BLOCK_SIZE = 2_000_000  # rows times lanes predicted at once: two minutes at 250 Hz
OVERLAP = 2  # half-overlapping windows; the mean is nearly as precise as with 1.5 times as many
BLOCK_S = 1.0  # of reported errors; longer than the correlation of windows and wake

# Candidate prediction windows, ascending. Over a near plate the beam diverges from any prediction
# within a second, so that errors of a few long windows are dominated by chance.
WINDOWS_S = (0.25, 0.5, 1.0)

# 95 % quantile of a true model's error above its mean, relative, at which a window is predictable.
# Half of the 10 % allowed for a gap above its floor; the rest is for the wake torque; assumed.
MAX_FLOOR_SPREAD = 0.05
FLOOR_DRAWS = 32  # simulated recordings for that quantile
ONE_SIDED_95 = 1.645  # normal quantile


def read_channels(logged: LoggedPitch) -> dict[str, Array]:
    """Return readings (n,), speeds (n, n_discs), by channel in its unit."""
    rpm = RPM * logged.speed_rad_s.T
    return {"theta_rad": logged.theta_rad, "gyro_rad_s": logged.gyro_rad_s, "rpm": rpm}


def predicted_channels(run: Predictions) -> dict[str, Array]:
    """Return predictions (n, lanes), speeds (n, n_discs, lanes), by channel in its unit."""
    return {"theta_rad": run.theta_rad, "gyro_rad_s": run.gyro_rad_s, "rpm": RPM * run.speed_rad_s}


class Windows:
    """Windows of a log without dropouts, after the filter has settled.

    Each begins after 1/`overlap` of the previous one.
    """

    def __init__(self, log: FilteredLog, window_s: float, overlap: int = 1) -> None:
        self.log, rate_Hz = log, log.logged.rate_Hz
        self.rows = rows = max(2, round(window_s * rate_Hz))
        hop = max(1, rows // overlap)
        n_settling = round(SETTLING_S * rate_Hz)
        starts = {
            start
            for segment in find_segments(log.logged.mode)
            for start in range(segment.start + n_settling, segment.stop - rows + 1, hop)
        }
        self.starts = np.array(sorted(starts), np.intp)  # first rows
        self.block = max(1, round(BLOCK_S * rate_Hz / hop))  # consecutive windows in a block

    def errors(self, benches: Sequence[PitchBench]) -> dict[str, Array]:
        """Return mean squared errors of each block (b, lanes) by channel."""
        errors: dict[str, list[Array]] = {name: [] for name in CHANNELS}
        readings, states = read_channels(self.log.logged), self.states(benches)
        for part in self._parts(len(benches)):
            runs = self.run(benches, part, states[part])
            for start, run in zip(self.starts[part], runs, strict=True):
                for name, values in predicted_channels(run).items():
                    error = readings[name][start : start + self.rows, ..., None] - values
                    if np.isfinite(error).any():
                        errors[name].append(np.nanmean(error**2, axis=tuple(range(error.ndim - 1))))
        means = dict[str, Array]()
        for name, squares in errors.items():
            if squares:  # the last block includes the remaining windows
                firsts = self.block * np.arange(max(1, len(squares) // self.block))
                sizes = np.diff([*firsts, len(squares)])
                means[name] = np.add.reduceat(np.array(squares), firsts) / sizes[:, None]
        return means

    def floor(
        self, bench: PitchBench, truths: Sequence[PitchBench], rng: np.random.Generator
    ) -> dict[str, Array]:
        """Return root mean squared errors of a true model (draws,) by channel.

        Args:
            truths: true model of each draw: the model itself, or draws of its parameters.
        """
        states = self.states([bench])
        squares = {name: np.zeros(len(truths)) for name in CHANNELS}
        for part in self._parts(min(len(truths), MAX_LANES)):
            nominal = self.run([bench], part, states[part])
            for first in range(0, len(truths), MAX_LANES):
                lanes = slice(first, first + MAX_LANES)
                starts = [np.repeat(state, len(truths[lanes]), axis=1) for state in states[part]]
                for state in starts:
                    noise = rng.standard_normal((3, state.shape[1]))
                    state[:3] += self.log.filter.state_root @ noise
                seed = int(rng.integers(2**31))
                runs = self.run(truths[lanes], part, starts, seed)
                for name, increments in self._squares(runs, nominal, rng).items():
                    squares[name][lanes] += increments
        return {name: np.sqrt(total / len(self.starts)) for name, total in squares.items()}

    def _squares(
        self, runs: Sequence[Predictions], nominal: Sequence[Predictions], rng: np.random.Generator
    ) -> dict[str, Array]:
        """Return mean squared errors (lanes,) with sensor noise, summed over windows."""
        total = dict.fromkeys(CHANNELS, np.zeros(runs[0].theta_rad.shape[-1]))
        for run, expected in zip(runs, map(predicted_channels, nominal), strict=True):
            for name, prediction in predicted_channels(run).items():
                noise = rng.standard_normal(prediction.shape, np.float32)
                noise = self.log.filter.reading_sd[name] * noise
                scale = RPM if name == "rpm" else 1.0
                error = prediction - expected[name] + scale * noise.astype(float)
                total[name] = total[name] + np.mean(error**2, axis=tuple(range(error.ndim - 1)))
        return total

    def _parts(self, lanes: int) -> list[slice]:
        """Return the windows in parts that fit in memory."""
        n_windows = max(1, MAX_BLOCK_SIZE // (self.rows * lanes))
        return [slice(first, first + n_windows) for first in range(0, len(self.starts), n_windows)]

    def states(self, benches: Sequence[PitchBench]) -> list[Array]:
        """Return the filter's state before each window (4 + n_discs, lanes)."""
        states = filter_states(benches, self.log.logged, self.log.filter.gains)
        return [states[row] for row in self.starts]

    def run(
        self,
        benches: Sequence[PitchBench],
        part: slice,
        states: Sequence[Array],
        seed: int | None = None,
    ) -> list[Predictions]:
        """Return predictions of each bench (lane) in some windows, from states before them."""
        logged = self.log.logged
        lead = round(LEAD_S * logged.rate_Hz)
        windows = dict(zip(map(int, self.starts[part]), states, strict=True))
        return predict_windows(benches, logged, windows, self.rows, lead, seed)


class PitchSubject(Subject):
    """Pitch recordings, compared with a model."""

    kind = "pitch"
    summarize = staticmethod(summarize_residuals)
    designer = PitchDesigner
    evidence: PitchEvidence
    check_evidence: PitchEvidence
    all_evidence: PitchEvidence

    @staticmethod
    def gather(model: Model, logs: Sequence[PitchLog], extra: Sequence[Effect]) -> PitchEvidence:
        return PitchEvidence(model, [log.logged for log in logs], extra)

    @cached_property
    def window_s(self) -> float:
        """Longest window over which the plant is predictable: s.

        Judged by simulated validation recordings of the model as given, with the stated noise.
        """
        as_given = np.zeros(len(self.evidence.parameters))
        predictable = WINDOWS_S[0]
        for window_s in WINDOWS_S[1:]:
            changes, rng = np.empty((0, FLOOR_DRAWS)), np.random.default_rng(0)
            floors = self.floor(as_given, changes, rng, window_s=window_s)
            relative_sd = max(np.std(roots) / np.mean(roots) for roots in floors.values())
            if ONE_SIDED_95 * relative_sd > MAX_FLOOR_SPREAD:
                break
            predictable = window_s
        return predictable

    def errors(self, sets: Array, changes: Array) -> Mapping[str, Array]:
        errors: dict[str, list[Array]] = {}
        for log in self.check_evidence.logs:
            benches = [self.check_evidence.bench(scaled, log.logged.rate_Hz) for scaled in sets]
            windows = Windows(log, self.window_s, OVERLAP)
            for name, squares in windows.errors(benches).items():
                errors.setdefault(name, []).append(squares)
        return {name: np.concatenate(squares) for name, squares in errors.items()}

    def floor(
        self,
        at: Array,
        changes: Array,
        rng: np.random.Generator,
        spread: Array | None = None,
        window_s: float | None = None,
    ) -> Mapping[str, Array]:
        total: dict[str, Array] = {}
        count, draws = 0, changes.shape[1]
        for log in self.check_evidence.logs:
            windows = Windows(log, window_s or self.window_s, OVERLAP)
            bench = self.check_evidence.bench(at, log.logged.rate_Hz)
            truths = [bench] * draws
            if spread is not None:
                scaled = rng.multivariate_normal(at, spread, draws, method="eigh")
                truths = [self.check_evidence.bench(x, log.logged.rate_Hz) for x in scaled]
            for name, roots in windows.floor(bench, truths, rng).items():
                total[name] = total.get(name, 0.0) + len(windows.starts) * roots**2
            count += len(windows.starts)
        return {name: np.sqrt(squares / max(count, 1)) for name, squares in total.items()}

    def overlays(self, before: Array, after: Array) -> tuple[Overlay, ...]:
        """Return the first check recording with the predictions of each window, by channel."""
        log = self.check_evidence.logs[0]
        rate_Hz = log.logged.rate_Hz
        windows = Windows(log, self.window_s)
        benches = [self.check_evidence.bench(values, rate_Hz) for values in (before, after)]
        runs = windows.run(benches, slice(None), windows.states(benches))
        overlays = []
        for name, read in read_channels(log.logged).items():
            values = read if read.ndim == 1 else read[:, 0]
            if not np.isfinite(values).any():
                continue
            pieces = []
            for start, run in zip(windows.starts, runs, strict=True):
                rows = np.arange(start, start + windows.rows)
                prediction = predicted_channels(run)[name]
                prediction = prediction if read.ndim == 1 else prediction[:, 0]
                pieces.append(np.column_stack([rows / rate_Hz, values[rows], prediction]))
            channel = "rpm1" if name == "rpm" else name
            overlays.append(build_overlay(channel, "time_s", pieces))
        return tuple(overlays)
