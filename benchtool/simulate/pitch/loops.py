"""The pitch bench's loops, made for a set of effects, a law, and numbers of discs and lanes."""

from __future__ import annotations

from collections import namedtuple
from functools import lru_cache
from typing import Any

from benchtool.physics.disc_thrust import ImageRules
from benchtool.physics.effects.effect import Effect
from benchtool.physics.expression import (
    borrowed,
    compiled_closure,
    expression,
    loop_part,
    read_record,
    write_record,
)
from benchtool.physics.fold import identity
from benchtool.simulate.controllers.controller import ControlLaw
from benchtool.simulate.hooks import identities, joined_hooks
from benchtool.simulate.kernel import PULSES, Build, Phases, always, nothing, run_ticks
from benchtool.simulate.layout import Layout
from benchtool.simulate.noise import later_state
from benchtool.simulate.pitch.filter_ticks import GAINS, correct_lane, logged_slot
from benchtool.simulate.pitch.lane import sense_lane, step_lane
from benchtool.simulate.pitch.law import (
    control_lane,
    divide_lane,
    drive_lane,
    expect_lane,
    mix_lane,
    turn_lane,
)
from benchtool.simulate.pitch.records import (
    FRESH,
    PAST,
    Delayed,
    PitchArrays,
    geometry_slot,
    tick_slot,
)

LAST = PAST - 1  # picks the place of a tick among `PAST`

PitchLoops = namedtuple("PitchLoops", "run filter")
"""Hold compiled loops: run(arrays, plan, first, last), with the arrays as `layout.lent`, and
filter, the same along a log.
"""


@lru_cache(maxsize=64)
def pitch_loops(
    effects: tuple[Effect, ...],
    layout: Layout,
    n_discs: int,
    lanes: int,
    rules: ImageRules,
    law: ControlLaw,
) -> PitchLoops:
    """Return the loops of these effects and this law."""
    to, ones, build = layout.places, (1.0,) * n_discs, Build(tuple(range(lanes)), layout.places)
    planned, logged = tick_slot(n_discs), logged_slot(n_discs)
    slot, like = geometry_slot(n_discs, rules.n_body), PitchArrays()
    hooks, step = joined_hooks(effects, n_discs, rules), law.step
    fixed = expression(lambda a: read_record(a.geometry, slot, 0, 1))
    wanted = loop_part(lambda a, tick: read_record(a.schedule, planned, tick, a.schedule.shape[1]))
    shown = loop_part(lambda a, tick: read_record(a.schedule, logged, tick, a.schedule.shape[1]))

    @loop_part
    def control(a: Any, now: Any) -> None:
        for lane in range(lanes):
            control_lane(a.w, lane, lanes, now, to, step)

    @loop_part
    def correct(a: Any, now: Any) -> None:
        by = read_record(a.gains, GAINS, 0, 1)
        for lane in range(lanes):
            correct_lane(a.w, lane, lanes, now, by, to, hooks())

    @loop_part
    def mix(a: Any, now: Any) -> None:
        if now.wanted.feedforward > 0.0:
            for lane in range(lanes):
                expect_lane(a.w, lane, lanes, now, to, hooks())
        else:
            for lane in range(lanes):
                divide_lane(a.w, lane, lanes, ones, to)
        if now.plan.driver == PULSES:
            for lane in range(lanes):
                drive_lane(a.w, lane, lanes, now, to)
        else:
            for lane in range(lanes):
                mix_lane(a.w, lane, lanes, now, to)
        for lane in range(lanes):
            turn_lane(a.w, lane, lanes, now, to, hooks())

    @loop_part
    def drive(a: Any, now: Any) -> None:
        for lane in range(lanes):
            drive_lane(a.w, lane, lanes, now, to)
        for lane in range(lanes):
            turn_lane(a.w, lane, lanes, now, to, hooks())

    @loop_part
    def move(a: Any, now: Any) -> None:
        for lane in range(lanes):
            step_lane(a.w, lane, lanes, a.states, now, to, hooks())

    @loop_part
    def sense(a: Any, now: Any) -> None:
        w, place, plan = a.w, now.tick & LAST, now.plan
        for lane in range(lanes):
            hinge, plate = read_record(w, to.hinge, lane, lanes), now.wanted.setpoint
            a.past[0, place, lane] = hinge.theta_rad
            a.past[1, place, lane] = hinge.rate_rad_s
            a.past[2, place, lane] = plate.plate_z_m
        theta_at, rate_at = (now.tick - plan.late_theta) & LAST, (now.tick - plan.late_rate) & LAST
        plate_at = (now.tick - plan.late_plate) & LAST
        for lane in range(lanes):
            late = Delayed(
                a.past[0, theta_at, lane], a.past[1, rate_at, lane], a.past[2, plate_at, lane]
            )
            write_record(w, to.delayed, lane, lanes, late)
        fresh = read_record(a.fresh, FRESH, now.tick, a.fresh.shape[1])
        if fresh.theta + fresh.gyro + fresh.plate + fresh.speed > 0.0:
            for lane in range(lanes):
                sense_lane(w, lane, lanes, a.states, fresh, now.time_s, to, hooks())
        else:  # the readings stay, and the noise goes on as if they were read
            for lane in range(lanes):
                a.states[lane] = later_state(a.states[lane], 2 * (3 + n_discs))

    closed: Any = expression(lambda: Phases(fixed, wanted, control, mix, move, sense, always))
    along: Any = expression(lambda: Phases(fixed, shown, correct, drive, move, nothing, always))
    key = repr((n_discs, lanes, rules, identity(step), layout.records, identities(effects)))

    def run(arrays: Any, plan: Any, first: Any, last: Any) -> Any:
        return run_ticks(borrowed(arrays, like), plan, first, last, build, closed())

    def filter_(arrays: Any, plan: Any, first: Any, last: Any) -> Any:
        return run_ticks(borrowed(arrays, like), plan, first, last, build, along())

    return PitchLoops(compiled_closure(run, key), compiled_closure(filter_, key))
