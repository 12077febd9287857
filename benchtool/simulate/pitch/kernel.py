"""The pitch bench in closed loop: sensors, controller, mixer, hinge, for every lane.

One source for every use: a single run (one lane), a batch (several lanes that the compiler runs
side by side), a controller written in Python (one tick per call), and plain NumPy where numba is
not installed. `lanes` is a tuple with one entry per lane: its length is known when the loop is
compiled, and the loops over lanes hold no other loop.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from benchtool.physics.expression import loop_part, read_record, write_record
from benchtool.simulate.kernel import BUILT_IN, PULSES
from benchtool.simulate.layout import line, plane, solid
from benchtool.simulate.motors import arrive_lane
from benchtool.simulate.pitch.lane import sense_lane, step_lane
from benchtool.simulate.pitch.law import control_lane, expect_lane, mix_lane, turn_lane
from benchtool.simulate.pitch.records import (
    FRESH,
    PLAN,
    Command,
    Delayed,
    Places,
)


class LoopArrays(NamedTuple):
    """Hold the arrays of a run.

    Attributes:
        w: records of every lane, flat: row times lanes plus lane (`records.Places`).
        states: state of each lane's random numbers (n_lanes,).
        sent: speeds commanded lately (n_discs, n_ring, n_lanes).
        past: true pitch, rate and plate distance lately (3, n_past, n_lanes), for delayed sensors.
        log: (n_ticks, n_logged, n_lanes), filled with the rows `logged` of each tick.
        logged: rows to log (n_logged,).
        schedule: (n_rows, n_ticks), a `Tick` per column.
        fresh: (n_sensors, n_ticks + 1) which sensors have a new reading at a tick.
        geometry: a `Geometry` (n_numbers,).
    """

    w: Any
    states: Any
    sent: Any
    past: Any
    log: Any
    logged: Any
    schedule: Any
    fresh: Any
    geometry: Any


@loop_part
def unpacked_arrays(block: Any, places: Any) -> LoopArrays:
    """Return the arrays that `in_one_block` put into a block, as views."""
    return LoopArrays(
        w=line(block, places, 0),
        states=line(block, places, 1).view(np.int64),
        sent=solid(block, places, 2),
        past=solid(block, places, 3),
        log=solid(block, places, 4),
        logged=line(block, places, 5).view(np.int64),
        schedule=plane(block, places, 6),
        fresh=plane(block, places, 7),
        geometry=line(block, places, 8),
    )


class Build(NamedTuple):
    """Hold what a loop is compiled for.

    Attributes:
        lanes: one entry per lane.
        to: where records stand.
        tick: slot of a schedule's column.
        geometry: slot of the discs' places.
        ones: 1 for each disc.
    """

    lanes: Any
    to: Places
    tick: Any
    geometry: Any
    ones: Any


@loop_part
def run_ticks(a: Any, plan: Any, first: Any, last: Any, build: Any, law: Any, hooks: Any) -> None:
    """Run control ticks of every lane.

    Args:
        a: `LoopArrays`.
        plan: `PitchPlan`, as integers.
        first: control tick to begin with.
        last: control tick to stop before.
        build: `Build`.
        law: step of the built-in law.
        hooks: `hooks.Hooks`.
    """
    w, to, at = a.w, build.to, len(build.lanes)
    now = read_record(plan, PLAN, 0, 1)
    discs = read_record(a.geometry, build.geometry, 0, 1)
    dt_s, substeps, n_ticks = discs.dt_s, now.substeps, a.schedule.shape[1]
    span = 0.0
    for i in range(len(discs.x_m)):
        span = span + discs.roots[i] * discs.roots[i] * discs.x_m[i] * discs.x_m[i]
    for tick in range(first, last):
        time_s = tick * substeps * dt_s
        planned = read_record(a.schedule, build.tick, tick, n_ticks)
        for lane in range(at):
            write_record(w, to.setpoint, lane, at, planned.setpoint)
        if now.driver == BUILT_IN:
            for lane in range(at):
                control_lane(w, lane, at, time_s, planned.observer, substeps * dt_s, to, law)
        if planned.feedforward > 0.0:
            for lane in range(at):
                expect_lane(w, lane, at, planned, time_s, discs, to, hooks)
        else:
            for lane in range(at):
                before = read_record(w, to.command, lane, at)
                write_record(
                    w, to.command, lane, at,
                    Command(before.torque_Nm, before.difference_us, build.ones, before.pwm_us),
                )  # fmt: skip
        if now.driver == PULSES:
            for lane in range(at):
                before = read_record(w, to.command, lane, at)
                write_record(
                    w, to.command, lane, at,
                    Command(before.torque_Nm, before.difference_us, before.factor, planned.pwm_us),
                )  # fmt: skip
        else:
            for lane in range(at):
                mix_lane(w, lane, at, planned, span, discs, to)
        send_all(a, tick, time_s, discs, build, hooks)
        move_all(a, now, tick, substeps, time_s, discs, build, hooks)
        sense_all(a, now, tick + 1, discs, build, hooks)


@loop_part
def send_all(a: Any, tick: Any, time_s: Any, discs: Any, build: Any, hooks: Any) -> None:
    """Send the pulses of a tick on their way to the rotors of every lane, and log the tick."""
    w, to, at = a.w, build.to, len(build.lanes)
    for lane in range(at):
        turn_lane(w, lane, at, time_s, discs, to, hooks)
    place = tick % a.sent.shape[1]
    for i in range(len(discs.x_m)):
        for lane in range(at):
            a.sent[i, place, lane] = read_record(w, to.targets, lane, at).sent_rad_s[i]
    for channel in range(len(a.logged)):
        for lane in range(at):
            a.log[tick, channel, lane] = w[a.logged[channel] * at + lane]


@loop_part
def move_all(
    a: Any, now: Any, tick: Any, steps: Any, time_s: Any, discs: Any, build: Any, hooks: Any,
) -> None:  # fmt: skip
    """Advance the bench of every lane by so many plant steps."""
    w, to, at = a.w, build.to, len(build.lanes)
    for part in range(steps):
        if now.delayed > 0:
            for lane in range(at):
                arrive_lane(w, lane, at, a.sent, tick * now.substeps + part, now.substeps, to)
        for lane in range(at):
            step_lane(w, lane, at, a.states, discs, time_s, to, hooks)


@loop_part
def sense_all(a: Any, now: Any, tick: Any, discs: Any, build: Any, hooks: Any) -> None:
    """Read every sensor of every lane at the beginning of a tick."""
    w, to, at, length = a.w, build.to, len(build.lanes), a.past.shape[1]
    place = tick % length
    for lane in range(at):
        hinge, plate = read_record(w, to.hinge, lane, at), read_record(w, to.setpoint, lane, at)
        a.past[0, place, lane] = hinge.theta_rad
        a.past[1, place, lane] = hinge.rate_rad_s
        a.past[2, place, lane] = plate.plate_z_m
    theta_at, rate_at = (tick - now.late_theta) % length, (tick - now.late_rate) % length
    plate_at = (tick - now.late_plate) % length
    for lane in range(at):
        late = Delayed(
            a.past[0, theta_at, lane], a.past[1, rate_at, lane], a.past[2, plate_at, lane]
        )
        write_record(w, to.delayed, lane, at, late)
    fresh = read_record(a.fresh, FRESH, tick, a.fresh.shape[1])
    for lane in range(at):
        sense_lane(w, lane, at, a.states, fresh, discs, to, hooks)
