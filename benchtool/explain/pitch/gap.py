"""The gap: how far a model's prediction over a window is from a recording, and how far it must be.

Each window starts from a state that the filter estimated from earlier samples only, and runs free.
The floor is what the same prediction would miss if the model were the truth: a start as uncertain
as the filter says, the stated wake torque, the stated sensor noise; never the residual itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.explain.pitch.filter import PitchFilter, reading_sd
from benchtool.simulate.pitch import track as t
from benchtool.simulate.pitch.bench import PitchBench, PitchSensor, rig_sensors
from benchtool.simulate.pitch.follow import Followed, LoggedPitch, follow, follow_windows

CHANNELS = ("theta_rad", "gyro_rad_s", "rpm")
"""What a gap is reported for."""

LEAD_S = 0.1
"""How much of the pulses before a window a delay may still hold."""


AT_ONCE = 32
"""How many truths are simulated together."""

OVERLAP = 2
"""A window begins in the middle of the one before: what it misses is then counted twice, which
steadies the mean nearly as much as half as many windows more would."""

BLOCK_S = 1.0
"""Length of the blocks that errors are reported for, longer than what windows and wake share."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Windows:
    """Cut a log into windows.

    Attributes:
        starts: (w,) first rows.
        rows: rows of a window.
        block: how many windows one after the other make a block.
    """

    starts: NDArray[np.intp]
    rows: int
    block: int = 1


def windows_of(
    logged: LoggedPitch, window_s: float, settling_s: float, overlap: int = 1
) -> Windows:
    """Return windows that follow each other: none across a gap, none before a filter settled.

    Args:
        logged: the recording.
        window_s: their length.
        settling_s: what a filter needs after it began anew.
        overlap: a window begins after so great a part of the one before.
    """
    rows = max(2, round(window_s * logged.rate_Hz))
    hop = max(1, rows // overlap)
    wait = round(settling_s * logged.rate_Hz)
    edges = [0, *np.flatnonzero(logged.mode == t.RESTART), len(logged)]
    starts = [
        start
        for first, last in pairwise(edges)
        for start in range(first + wait, last - rows + 1, hop)
    ]
    block = max(1, round(BLOCK_S * logged.rate_Hz / hop))
    return Windows(starts=np.array(sorted(set(starts)), np.intp), rows=rows, block=block)


def predicted(
    benches: Sequence[PitchBench], logged: LoggedPitch, filter_: PitchFilter, windows: Windows
) -> list[Followed]:
    """Return what each bench (a lane) predicts in each window, from its own estimate on."""
    whole = follow(benches, logged, filter_.gains)
    states = [_state(whole, start) for start in windows.starts]
    return _free(benches, logged, windows, states)


def errors(logged: LoggedPitch, windows: Windows, found: Sequence[Followed]) -> dict[str, Array]:
    """Return mean squared errors of each block (b, lanes) by channel, in the channel's unit."""
    out: dict[str, list[Array]] = {name: [] for name in CHANNELS}
    for start, run in zip(windows.starts, found, strict=True):
        rows = slice(start, start + windows.rows)
        seen = {
            "theta_rad": logged.theta_rad[rows, None] - run.theta_rad,
            "gyro_rad_s": logged.gyro_rad_s[rows, None] - run.gyro_rad_s,
            "rpm": (logged.speed_rad_s[:, rows].T[:, :, None] - run.speed_rad_s) * 30.0 / np.pi,
        }
        for name, error in seen.items():
            axes = tuple(range(error.ndim - 1))
            if np.isfinite(error).any():
                out[name].append(np.nanmean(error**2, axis=axes))
    return {name: _in_blocks(np.array(s), windows.block) for name, s in out.items() if s}


def _in_blocks(squares: Array, block: int) -> Array:
    """Return means of blocks of windows; what is too short for one more joins the last."""
    count = max(1, len(squares) // block)
    firsts = block * np.arange(count)
    sizes = np.diff([*firsts, len(squares)])
    means: Array = np.add.reduceat(squares, firsts) / sizes[:, None]
    return means


def floor(
    bench: PitchBench,
    truths: Sequence[PitchBench],
    logged: LoggedPitch,
    filter_: PitchFilter,
    windows: Windows,
    rng: np.random.Generator,
) -> dict[str, Array]:
    """Return root mean squared errors of a true model (draws,) by channel, in the channel's unit.

    Args:
        bench: the model that predicts.
        truths: what is taken for true, one for each draw of the noise: the model itself, or models
            as far from it as its numbers are uncertain.
        logged: the recording whose pulses and distances drive it.
        filter_: of the recording.
        windows: as for the gap.
        rng: of the noise.
    """
    sensors = rig_sensors(bench.model.rig)
    whole = follow([bench], logged, filter_.gains)
    states = [_state(whole, start) for start in windows.starts]
    quiet = _free([bench], logged, windows, states)
    sd = {name: reading_sd(sensors.get(name, PitchSensor())) for name in CHANNELS}
    parts: dict[str, list[Array]] = {name: [] for name in CHANNELS}
    for first in range(0, len(truths), AT_ONCE):
        some = truths[first : first + AT_ONCE]
        spread = [np.repeat(state, len(some), axis=1) for state in states]
        for state in spread:
            state[:3] += filter_.state_root @ rng.standard_normal((3, len(some)))
        runs = _free(some, logged, windows, spread, seed=int(rng.integers(2**31)))
        total = dict.fromkeys(CHANNELS, np.zeros(len(some)))
        for run, still in zip(runs, quiet, strict=True):
            for name, error, scale in (
                ("theta_rad", run.theta_rad - still.theta_rad, 1.0),
                ("gyro_rad_s", run.gyro_rad_s - still.gyro_rad_s, 1.0),
                ("rpm", run.speed_rad_s - still.speed_rad_s, 30.0 / np.pi),
            ):
                noisy = scale * (error + sd[name] * rng.standard_normal(error.shape, np.float32))
                total[name] = total[name] + np.mean(noisy**2, axis=tuple(range(error.ndim - 1)))
        for name, squares in total.items():
            parts[name].append(np.sqrt(squares / len(windows.starts)))
    return {name: np.concatenate(roots) for name, roots in parts.items()}


def expected_leftover(
    bench: PitchBench,
    logged: LoggedPitch,
    filter_: PitchFilter,
    windows: Windows,
    rng: np.random.Generator,
) -> float:
    """Return the variance of whitened innovations of pitch and gyro that a true model leaves.

    It is 1 for a smooth plant. Where dry friction lets go at random moments, a filter of constant
    gain is surprised, by a true model too.
    """
    whole = follow([bench], logged, filter_.gains)
    sensors = rig_sensors(bench.model.rig)
    states = [_state(whole, start) for start in windows.starts]
    true = [state + 0.0 for state in states]
    for one in true:
        one[:3] += filter_.state_root @ rng.standard_normal((3, 1))
    runs = _free([bench], logged, windows, true, seed=int(rng.integers(2**31)))
    total, count = 0.0, 0
    for start, state, run in zip(windows.starts, states, runs, strict=True):
        part = logged.between(start, start + windows.rows)
        seen = [
            run_channel[:, 0]
            + reading_sd(sensors.get(name, PitchSensor())) * rng.standard_normal(windows.rows)
            for run_channel, name in (
                (run.theta_rad, "theta_rad"), (run.gyro_rad_s, "gyro_rad_s"),
            )
        ]  # fmt: skip
        mode = np.full(windows.rows, float(t.CORRECT))
        mode[0] = t.FREE
        again = follow(
            [bench],
            replace(
                part, theta_rad=seen[0], gyro_rad_s=seen[1], mode=mode,
                speed_rad_s=np.ascontiguousarray(run.speed_rad_s[:, :, 0].T),
            ),
            filter_.gains, start_s=start / logged.rate_Hz, states=state,
        )  # fmt: skip
        white = filter_.whitener @ np.array(
            [seen[0] - again.theta_rad[:, 0], seen[1] - again.gyro_rad_s[:, 0]]
        )
        total += float(np.mean(white[:, 1:] ** 2))
        count += 1
    return total / count if count else 1.0


def _state(whole: Followed, row: int) -> Array:
    """Return what the filter knows after the row before (3 + n_discs, lanes).

    The state at `row` is that of the row before, run on for one tick: as it was predicted.
    """
    return np.vstack(
        [whole.pitch_rad[row], whole.rate_rad_s[row], whole.wake_Nm[row], whole.turning_rad_s[row]]
    )


def _free(
    benches: Sequence[PitchBench],
    logged: LoggedPitch,
    windows: Windows,
    states: Sequence[Array],
    seed: int | None = None,
) -> list[Followed]:
    lead = round(LEAD_S * logged.rate_Hz)
    return follow_windows(benches, logged, windows.starts, windows.rows, lead, states, seed)
