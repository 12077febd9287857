"""One closed loop for a vehicle that is held, hinged or free: control ticks made of plant steps.

One source for every use: a single run, a batch (several lanes that the compiler runs side by side),
a controller written in Python (one tick per call), a log that is filtered, and plain NumPy where
numba is not installed. What a vehicle does in each part of a tick is a phase, phase(a, now): for
every lane it reads the records that it needs and writes those that it changes.
"""

from __future__ import annotations

from collections import namedtuple
from typing import Any

from benchtool.physics.expression import Slot, inlined_expression, read_record
from benchtool.simulate.motors import apply_arrived_pulses

BUILT_IN, CALLER, PULSES = range(3)  # who controls: a law, the caller, or scheduled pulses

LoopPlan = namedtuple(
    "LoopPlan",
    "substeps driver delayed log_every before held late_theta late_rate late_plate",
    defaults=(1, 0, 0, 1, 0, 0, 0, 0, 0),
)
"""Integers of a run.

Attributes:
    substeps: plant steps per tick.
    before: ticks that lie before the first one in time.
    held: whether the plant stands still: commands are sent on their way, and nothing moves.
    late_theta, late_rate, late_plate: delays of a bench's sensors in ticks.
"""

PLAN = Slot(0, LoopPlan())


Build = namedtuple("Build", "lanes to")  # what a loop is compiled for: lanes, and slots of records

Instant = namedtuple("Instant", "tick time_s part plan fixed wanted")
"""Where a loop is: tick, the time at its beginning (s), plant step within it, plan; what no
lane changes (geometry, the length of a plant step `dt_s`), and what is wanted in the tick.
"""

Phases = namedtuple("Phases", "fixed wanted law mix move sense goes_on")
"""Hold what a vehicle does in each part of a tick.

Attributes:
    fixed: fixed(a) -> what no lane changes, read once; it has `dt_s`.
    wanted: wanted(a, tick) -> what is wanted, from the schedule.
    mix: from a command to the speeds that the motors are to reach.
    move: a plant step: surround (heights and coverages), wrench, motion.
    goes_on: goes_on(a) -> whether there is a next step.
"""


@inlined_expression
def no_phase(a: Any, now: Any) -> None:
    """Stand for a phase in which nothing happens."""


@inlined_expression
def always_true(a: Any) -> bool:
    """Return that there is a next step."""
    return True


@inlined_expression
def run_ticks(a: Any, plan: Any, first: Any, last: Any, build: Any, phases: Any) -> Any:
    """Run control ticks of every lane, and return the one at which the run ended.

    Args:
        a: arrays: `w`, the records of every lane, flat, row times lanes plus lane; `sent`, speeds
            commanded lately (n_rotors, n_ring, n_lanes); `log` (n_rows, n_logged, n_lanes), filled
            with the rows `logged` of `w`; and what the phases need.
        first: control tick to begin with; -1 only senses.
        last: control tick to stop before.
        build: `Build`. The number of lanes is known when the loop is compiled, and the loops over
            lanes hold no other loop.
    """
    w, to, at = a.w, build.to, len(build.lanes)
    now = read_record(plan, PLAN, 0, 1)
    fixed, steps, ring = phases.fixed(a), now.substeps * (1 - now.held), a.sent.shape[1]
    place, row = max(first, 0) % ring, (max(first, 0) + now.log_every - 1) // now.log_every
    for tick in range(first, last):
        wanted = phases.wanted(a, max(tick, 0))
        if tick >= 0:
            time_s = (now.before + tick) * now.substeps * fixed.dt_s
            instant = Instant(tick, time_s, 0, now, fixed, wanted)
            if now.driver == BUILT_IN:
                phases.law(a, instant)
            phases.mix(a, instant)
            for i in range(len(to.targets.like.sent_rad_s)):
                for lane in range(at):
                    a.sent[i, place, lane] = read_record(w, to.targets, lane, at).sent_rad_s[i]
            place = place + 1 if place + 1 < ring else 0  # a remainder costs a tenth of a tick
            if tick == row * now.log_every:
                for channel in range(len(a.logged)):
                    for lane in range(at):
                        a.log[row, channel, lane] = w[a.logged[channel] * at + lane]
                row += 1
            for part in range(steps):
                if now.delayed > 0:
                    for lane in range(at):
                        step = tick * now.substeps + part
                        apply_arrived_pulses(w, lane, at, a.sent, step, now.substeps, to)
                phases.move(a, Instant(tick, time_s, part, now, fixed, wanted))
                if not phases.goes_on(a):
                    return tick
        time_s = (now.before + tick + 1) * now.substeps * fixed.dt_s
        phases.sense(a, Instant(tick + 1, time_s, 0, now, fixed, wanted))
    return last
