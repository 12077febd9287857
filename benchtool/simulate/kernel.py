"""One closed loop for a vehicle that is held, hinged or free: control ticks made of plant steps.

What a vehicle does in each part of a tick is a phase. A phase is a function of one lane that reads
the records it needs from the lane's column and writes those that it changes: phase(a, lane, now).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from benchtool.physics.expression import Slot, loop_part, read_record
from benchtool.simulate.motors import arrive_lane

BUILT_IN, CALLER, PULSES = range(3)
"""Who controls: a built-in law, the caller of each tick, or the pulses of a schedule."""


class LoopPlan(NamedTuple):
    """Integers of a run.

    Attributes:
        substeps: plant steps per tick.
        driver: who controls.
        delayed: whether commands arrive late.
        log_every: ticks from one row of the log to the next.
    """

    substeps: Any = 1
    driver: Any = 0
    delayed: Any = 0
    log_every: Any = 1


PLAN = Slot(0, LoopPlan())


class Instant(NamedTuple):
    """Where a loop is: tick, the time at its beginning (s), plant step within it, plan, and what no
    lane changes (geometry, the length of a plant step `dt_s`).
    """

    tick: Any
    time_s: Any
    part: Any
    plan: Any
    fixed: Any


class Phases(NamedTuple):
    """Hold what a vehicle does in each part of a tick, as functions of one lane.

    Attributes:
        fixed: fixed(a) -> what no lane changes, read once; it has `dt_s`.
        law: from readings to a command.
        mix: from a command to the speeds that the motors are to reach.
        move: a plant step: surround (heights and coverages), wrench, motion.
        sense: readings at the beginning of a tick.
        goes_on: goes_on(a) -> whether there is a next step.
    """

    fixed: Any
    law: Any
    mix: Any
    move: Any
    sense: Any
    goes_on: Any


@loop_part
def run_ticks(a: Any, plan: Any, first: Any, last: Any, build: Any, phases: Any) -> Any:
    """Run control ticks of every lane, and return the one at which the run ended.

    Args:
        a: arrays: `w`, the records of every lane, flat, row times lanes plus lane; `sent`, speeds
            commanded lately (n_rotors, n_ring, n_lanes); `log` (n_rows, n_logged, n_lanes), filled
            with the rows `logged` of `w`; and what the phases need.
        plan: `LoopPlan`, as integers.
        first: control tick to begin with; -1 only senses.
        last: control tick to stop before.
        build: `lanes`, a tuple with one entry per lane, and `to`, where records stand.
        phases: `Phases`.
    """
    w, to, at = a.w, build.to, len(build.lanes)
    now = read_record(plan, PLAN, 0, 1)
    fixed = phases.fixed(a)
    for tick in range(first, last):
        time_s = tick * now.substeps * fixed.dt_s
        if tick >= 0:
            instant = Instant(tick, time_s, 0, now, fixed)
            if now.driver == BUILT_IN:
                for lane in range(at):
                    phases.law(a, lane, instant)
            for lane in range(at):
                phases.mix(a, lane, instant)
            place = tick % a.sent.shape[1]
            for lane in range(at):
                sent = read_record(w, to.targets, lane, at).sent_rad_s
                for i in range(len(sent)):
                    a.sent[i, place, lane] = sent[i]
            if tick % now.log_every == 0:
                for channel in range(len(a.logged)):
                    for lane in range(at):
                        row = a.logged[channel] * at + lane
                        a.log[tick // now.log_every, channel, lane] = w[row]
            for part in range(now.substeps):
                if now.delayed > 0:
                    for lane in range(at):
                        step = tick * now.substeps + part
                        arrive_lane(w, lane, at, a.sent, step, now.substeps, to)
                instant = Instant(tick, time_s, part, now, fixed)
                for lane in range(at):
                    phases.move(a, lane, instant)
                if not phases.goes_on(a):
                    return tick
        instant = Instant(tick + 1, (tick + 1) * now.substeps * fixed.dt_s, 0, now, fixed)
        for lane in range(at):
            phases.sense(a, lane, instant)
    return last
