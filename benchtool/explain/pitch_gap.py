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

from benchtool.explain.pitch_filter import PitchFilter, reading_sd
from benchtool.simulate import pitch_track as t
from benchtool.simulate.pitch_bench import PitchBench, PitchSensor, rig_sensors
from benchtool.simulate.pitch_follow import Followed, LoggedPitch, follow

Array = NDArray[np.float64]

CHANNELS = ("theta_rad", "gyro_rad_s", "rpm")
"""What a gap is told for."""

LEAD_S = 0.1
"""How much of the pulses before a window a delay may still hold."""


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Windows:
    """Cut a log into windows.

    Attributes:
        starts: (w,) first rows.
        rows: rows of a window.
    """

    starts: NDArray[np.intp]
    rows: int


def windows_of(logged: LoggedPitch, window_s: float, settling_s: float) -> Windows:
    """Return windows that follow each other: none across a gap, none before a filter settled."""
    rows = max(2, round(window_s * logged.rate_Hz))
    wait = round(settling_s * logged.rate_Hz)
    edges = [0, *np.flatnonzero(logged.mode == t.RESTART), len(logged)]
    starts = [
        start
        for first, last in pairwise(edges)
        for start in range(first + wait, last - rows + 1, rows)
    ]
    return Windows(starts=np.array(sorted(set(starts)), np.intp), rows=rows)


def predicted(
    benches: Sequence[PitchBench], logged: LoggedPitch, filter_: PitchFilter, windows: Windows
) -> list[Followed]:
    """Return what each bench (a lane) predicts in each window, from its own estimate on."""
    whole = follow(benches, logged, filter_.gains)
    return [
        _free(benches, logged, filter_, start, windows.rows, _state(whole, start))
        for start in windows.starts
    ]


def errors(logged: LoggedPitch, windows: Windows, found: Sequence[Followed]) -> dict[str, Array]:
    """Return mean squared errors of each window (w, lanes) by channel, in the channel's unit."""
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
    return {name: np.array(squares) for name, squares in out.items() if squares}


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
    draws = len(truths)
    sensors = rig_sensors(bench.model.rig)
    whole = follow([bench], logged, filter_.gains)
    sd = {name: reading_sd(sensors.get(name, PitchSensor())) for name in CHANNELS}
    total: dict[str, Array] = {}
    for start in windows.starts:
        state = _state(whole, start)
        spread = np.repeat(state, draws + 1, axis=1)
        spread[:3, 1:] += filter_.state_root @ rng.standard_normal((3, draws))
        run = _free(
            [bench, *truths], logged, filter_, start, windows.rows, spread,
            seed=int(rng.integers(2**31)),
        )  # fmt: skip
        quiet = _free([bench], logged, filter_, start, windows.rows, state)
        for name, error, scale in (
            ("theta_rad", run.theta_rad[:, 1:] - quiet.theta_rad, 1.0),
            ("gyro_rad_s", run.gyro_rad_s[:, 1:] - quiet.gyro_rad_s, 1.0),
            ("rpm", run.speed_rad_s[:, :, 1:] - quiet.speed_rad_s, 30.0 / np.pi),
        ):
            noisy = error + sd[name] * rng.standard_normal(error.shape)
            squares = np.mean((scale * noisy) ** 2, axis=tuple(range(error.ndim - 1)))
            total[name] = total.get(name, 0.0) + squares
    return {name: np.sqrt(squares / len(windows.starts)) for name, squares in total.items()}


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
    total, count = 0.0, 0
    for start in windows.starts:
        state = _state(whole, start)
        true = np.array(state)
        true[:3] += filter_.state_root @ rng.standard_normal((3, 1))
        run = _free(
            [bench], logged, filter_, start, windows.rows, true, seed=int(rng.integers(2**31))
        )
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
    filter_: PitchFilter,
    start: int,
    rows: int,
    states: Array,
    seed: int | None = None,
) -> Followed:
    lead = min(start, round(LEAD_S * logged.rate_Hz))
    part = logged.between(start - lead, start + rows)
    mode = np.full(lead + rows, float(t.FREE))
    mode[:lead] = t.WAIT
    run = follow(
        benches, replace(part, mode=mode), filter_.gains,
        start_s=(start - lead) / logged.rate_Hz, states=states, seed=seed,
    )  # fmt: skip
    return Followed(*(getattr(run, name)[lead:] for name in Followed.__slots__))
