"""The pitch bench in closed loop: sensors, controller, mixer, hinge, for every lane.

One source for every use: a single run (one lane), a batch (several lanes that the compiler runs
side by side), a controller written in Python (one tick per call), and plain NumPy where numba is
not installed. `lanes` is a tuple with one entry per lane, `shared.x` one with one entry per disc:
their lengths are known when the loop is compiled, and the loops over lanes hold no other loop.
"""

from __future__ import annotations

from typing import Any

from benchtool.physics.expression import loop_part
from benchtool.simulate.pitch import rows as r
from benchtool.simulate.pitch.lane import arrive_lane, sense_lane, step_lane
from benchtool.simulate.pitch.law import control_lane, expect_lane, mix_lane, turn_lane
from benchtool.simulate.pitch.shared import Shared


@loop_part
def run_ticks(
    w: Any,
    states: Any,
    sent: Any,
    past: Any,
    log: Any,
    logged: Any,
    schedule: Any,
    fresh: Any,
    table: Any,
    distances: Any,
    arms: Any,
    plan: Any,
    dt_s: Any,
    lanes: Any,
    hooks: Any,
) -> None:
    """Run control ticks of every lane.

    Args:
        w: work space, flat: row times lanes plus lane (`pitch_rows`).
        states: state of each lane's random numbers (n_lanes,).
        sent: speeds commanded lately, flat: (disc times ring plus tick) times lanes plus lane.
        past: true pitch, rate and plate distance lately, the same way, for delayed sensors.
        log: (n_ticks, n_logged, n_lanes), filled with the rows `logged` of each tick.
        logged: rows to log (n_logged,).
        schedule: (9 or more, n_ticks), see `pitch_rows`.
        fresh: (n_ticks + 1, 4) which sensors have a new reading at a tick.
        table: (n, 3) places x, y of the discs and root of the rotors on each.
        distances: (n, n) between discs.
        arms: (n,) from the body's centre, for eq. (4).
        plan: integers (10,): first tick, tick to stop before, plant steps per tick, who controls
            (0 the built-in laws, 1 the caller, 2 pulses in the schedule), ring length of `sent`,
            whether commands are delayed, ring length of `past`, delays of encoder, gyro and plate
            in ticks.
        dt_s: plant step: s.
        lanes: one entry per lane, from the spelled-out module.
        hooks: the spelled-out effects.
    """
    at = len(lanes)
    first, last, substeps, external = plan[0], plan[1], plan[2], plan[3]
    ring, delayed = plan[4], plan[5]
    x, y, roots = hooks.places(table)
    between, centre = hooks.spans(distances, arms)
    span = 0.0
    for i in range(len(x)):
        span = span + roots[i] * roots[i] * x[i] * x[i]
    for tick in range(first, last):
        time_s = tick * substeps * dt_s
        shared = Shared(x, y, roots, between, centre, dt_s, time_s)
        for lane in range(at):
            w[r.REFERENCE * at + lane] = schedule[r.S_REFERENCE, tick]
            w[r.COLLECTIVE * at + lane] = schedule[r.S_COLLECTIVE, tick]
            w[r.PLATE * at + lane] = schedule[r.S_PLATE, tick]
            w[r.SHARE * at + lane] = schedule[r.S_SHARE, tick]
        if external == 0:
            observing = schedule[r.S_OBSERVER, tick]
            for lane in range(at):
                control_lane(w, lane, at, observing, substeps * dt_s)
        if schedule[r.S_FEEDFORWARD, tick] > 0.0:
            now = (schedule[r.S_BELIEVED_PLATE, tick], schedule[r.S_BELIEVED_SHARE, tick])
            for lane in range(at):
                expect_lane(w, lane, at, now, shared, hooks)
        else:
            for i in range(len(x)):
                for lane in range(at):
                    w[(r.FACTOR + i) * at + lane] = 1.0
        if external == 2:
            for i in range(len(x)):
                for lane in range(at):
                    w[(r.PWM + i) * at + lane] = schedule[r.S_PULSES + i, tick]
        else:
            dither = schedule[r.S_DITHER, tick]
            for lane in range(at):
                mix_lane(w, lane, at, dither, span, x)
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
        for part in range(substeps):
            if delayed > 0:
                for lane in range(at):
                    arrive_lane(w, lane, at, sent, tick * substeps + part, substeps, ring, x)
            for lane in range(at):
                step_lane(w, lane, at, states, shared, hooks)
        sense_all(w, states, past, fresh, schedule, plan, tick + 1, shared, lanes, hooks)


@loop_part
def sense_all(
    w: Any,
    states: Any,
    past: Any,
    fresh: Any,
    schedule: Any,
    plan: Any,
    tick: Any,
    shared: Any,
    lanes: Any,
    hooks: Any,
) -> None:
    """Read every sensor of every lane at the beginning of a tick; arguments as `run_ticks`."""
    at, length = len(lanes), plan[6]
    x, y = shared.x, shared.y
    for lane in range(at):
        past[(tick % length) * at + lane] = w[r.THETA * at + lane]
        past[(length + tick % length) * at + lane] = w[r.RATE * at + lane]
        past[(2 * length + tick % length) * at + lane] = w[r.PLATE * at + lane]
    for lane in range(at):
        w[r.SEEN_THETA * at + lane] = past[((tick - plan[7]) % length) * at + lane]
        w[r.SEEN_RATE * at + lane] = past[(length + (tick - plan[8]) % length) * at + lane]
        w[r.SEEN_PLATE * at + lane] = past[(2 * length + (tick - plan[9]) % length) * at + lane]
    nothing = shared.roots
    flow = hooks.bare(0.0, x, y, nothing, nothing, nothing, 0.0, 0.0, 0.0, 1.0, 0.0)
    new = fresh[tick]
    for lane in range(at):
        sense_lane(w, lane, at, states, new, hooks, flow, x)
