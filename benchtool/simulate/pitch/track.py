"""Follow a logged pitch experiment: the plant driven by logged pulses, corrected by the readings.

The same plant as in a closed loop, with a filter of constant gain around it. What the readings
show beyond the prediction of one tick is the innovation; with the right model it is white noise of
known size, whatever controller made the pulses. Every lane follows the same log with parameters
of its own, so that a derivative costs no more than a run.
"""

from __future__ import annotations

from typing import Any

from benchtool.physics.expression import loop_part
from benchtool.simulate.pitch import rows as r
from benchtool.simulate.pitch.lane import arrive_lane, step_lane
from benchtool.simulate.pitch.law import turn_lane
from benchtool.simulate.pitch.shared import Shared

FREE, CORRECT, RESTART, WAIT = range(4)
"""What to do with a tick: run on without its readings, correct by them, begin anew from them, or
only send its pulses, so that a delay has them when the plant begins to move."""

(SEEN_MODE, SEEN_THETA, SEEN_GYRO) = range(3)
SEEN_SPEEDS = 3
"""Rows of what was seen: mode, pitch, gyro, then the speed of each disc; nan where nothing was."""

(BY_THETA, BY_GYRO, RATE_BY_THETA, RATE_BY_GYRO, WAKE_BY_THETA, WAKE_BY_GYRO, SPEED_GAIN) = range(7)
"""Gains of the filter."""


@loop_part
def track_ticks(
    w: Any,
    states: Any,
    sent: Any,
    log: Any,
    logged: Any,
    schedule: Any,
    seen: Any,
    gains: Any,
    table: Any,
    distances: Any,
    arms: Any,
    plan: Any,
    dt_s: Any,
    before: Any,
    lanes: Any,
    hooks: Any,
) -> None:
    """Follow a log with every lane.

    What is not told here is as in `pitch_kernel.run_ticks`: the (3 + n, n_ticks) `seen` holds mode
    and readings (`SEEN_MODE` and the names beside it), the (7,) `gains` are the filter's and the
    same for all lanes, `before` is how many ticks of the experiment lie before the first row.
    """
    at = len(lanes)
    first, last, substeps, ring, delayed = plan[0], plan[1], plan[2], plan[4], plan[5]
    x, y, roots = hooks.places(table)
    between, centre = hooks.spans(distances, arms)
    for tick in range(first, last):
        shared = Shared(x, y, roots, between, centre, dt_s, (before + tick) * substeps * dt_s)
        for lane in range(at):
            w[r.PLATE * at + lane] = schedule[r.S_PLATE, tick]
            w[r.SHARE * at + lane] = schedule[r.S_SHARE, tick]
        for lane in range(at):
            correct_lane(w, lane, at, seen, tick, gains, shared, hooks)
        for i in range(len(x)):
            for lane in range(at):
                w[(r.PWM + i) * at + lane] = schedule[r.S_PULSES + i, tick]
        for lane in range(at):
            turn_lane(w, lane, at, shared, hooks)
        for i in range(len(x)):
            for lane in range(at):
                sent[(i * ring + tick % ring) * at + lane] = w[(r.TARGET + i) * at + lane]
                w[(r.OLD + i) * at + lane] = w[(r.TARGET + i) * at + lane]
                w[(r.NEW + i) * at + lane] = w[(r.TARGET + i) * at + lane]
        for channel in range(len(logged)):
            for lane in range(at):
                log[tick, channel, lane] = w[logged[channel] * at + lane]
        moving = substeps if seen[SEEN_MODE, tick] != WAIT else 0
        for part in range(moving):
            if delayed > 0:
                for lane in range(at):
                    arrive_lane(w, lane, at, sent, tick * substeps + part, substeps, ring, x)
            for lane in range(at):
                step_lane(w, lane, at, states, shared, hooks)


@loop_part
def correct_lane(
    w: Any, lane: Any, at: Any, seen: Any, tick: Any, gains: Any, shared: Any, hooks: Any
) -> None:
    """Predict the readings of a tick and correct one lane's state by what was seen."""
    x = shared.x
    nothing = shared.roots
    flow = hooks.bare(0.0, x, shared.y, nothing, nothing, nothing, 0.0, 0.0, 0.0, 1.0, 0.0)
    p = hooks.numbers(w, r.EFFECTS, lane, at)
    gyro = hooks.gyro(w[r.RATE * at + lane], flow, p)
    w[r.READ_THETA * at + lane] = w[r.THETA * at + lane]
    w[r.READ_GYRO * at + lane] = gyro
    mode = seen[SEEN_MODE, tick]
    pitch_error = seen[SEEN_THETA, tick] - w[r.THETA * at + lane]
    rate_error = seen[SEEN_GYRO, tick] - gyro
    pitch_error = pitch_error if pitch_error == pitch_error else 0.0
    rate_error = rate_error if rate_error == rate_error else 0.0
    if mode == CORRECT:
        w[r.THETA * at + lane] += gains[BY_THETA] * pitch_error + gains[BY_GYRO] * rate_error
        w[r.RATE * at + lane] += (
            gains[RATE_BY_THETA] * pitch_error + gains[RATE_BY_GYRO] * rate_error
        )
        w[r.WAKE * at + lane] += (
            gains[WAKE_BY_THETA] * pitch_error + gains[WAKE_BY_GYRO] * rate_error
        )
    elif mode == RESTART:
        w[r.THETA * at + lane] += pitch_error
        w[r.RATE * at + lane] += rate_error
        w[r.WAKE * at + lane] = 0.0
    for i in range(len(x)):
        w[(r.READ_SPEED + i) * at + lane] = w[(r.SPEED + i) * at + lane]
        error = seen[SEEN_SPEEDS + i, tick] - w[(r.SPEED + i) * at + lane]
        error = error if error == error else 0.0
        if mode == CORRECT:
            w[(r.SPEED + i) * at + lane] += gains[SPEED_GAIN] * error
        elif mode == RESTART:
            w[(r.SPEED + i) * at + lane] += error
