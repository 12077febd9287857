"""The pitch bench's loops, made for a set of effects, a law, and numbers of discs and lanes."""

from __future__ import annotations

from collections import namedtuple
from functools import lru_cache
from typing import Any

import numpy as np

from benchtool.physics.disc_thrust import ImageRules
from benchtool.physics.effects.effect import Effect
from benchtool.physics.expression import (
    compiled_closure,
    expression,
    inlined_expression,
    read_record,
    shared_view,
    with_fields,
    write_record,
)
from benchtool.physics.fold import identity
from benchtool.physics.rotor import pwm_from_speed, speed_from_pwm, speed_from_thrust
from benchtool.physics.tilt import LEVEL
from benchtool.simulate.controllers.controller import ControlLaw, PitchMeasurement, PitchReference
from benchtool.simulate.controllers.feedforward import compensated_thrust, expected_factor
from benchtool.simulate.hooks import identities, joined_hooks
from benchtool.simulate.kernel import PULSES, Build, Phases, always_true, no_phase, run_ticks
from benchtool.simulate.layout import Layout
from benchtool.simulate.motors import Targets
from benchtool.simulate.noise import later_state
from benchtool.simulate.pitch.filter_ticks import GAINS, correct_lane, logged_slot
from benchtool.simulate.pitch.lane import (
    heights_over,
    plane_below,
    rounded,
    scaled,
    sense_lane,
    step_lane,
)
from benchtool.simulate.pitch.records import (
    FRESH,
    PAST,
    Command,
    Delayed,
    PitchArrays,
    geometry_slot,
    tick_slot,
)

LAST = PAST - 1  # picks the place of a tick among `PAST`

PitchLoops = namedtuple("PitchLoops", "run filter")
"""Hold compiled loops: run(arrays, plan, first, last), with the arrays as `layout.lend_rows`, and
filter, the same along a log.
"""


@inlined_expression
def control_lane(w: Any, lane: Any, at: Any, now: Any, to: Any, law: Any) -> None:
    """Run a built-in law of one lane: a controller's step, with its state in the lane's records."""
    seen, wanted = read_record(w, to.readings, lane, at), now.wanted.setpoint
    before = read_record(w, to.command, lane, at)
    state, command = law(
        read_record(w, to.law, lane, at),
        read_record(w, to.law_state, lane, at),
        PitchMeasurement(
            now.time_s, seen.theta_rad, seen.gyro_rad_s, seen.plate_z_m, seen.speed_rad_s
        ),
        PitchReference(wanted.reference_rad, wanted.collective_N, now.wanted.observer),
        now.plan.substeps * now.fixed.dt_s,
    )
    write_record(w, to.law_state, lane, at, state)
    asked = Command(command.torque_Nm, command.difference_us, before.factor, before.pwm_us)
    write_record(w, to.command, lane, at, asked)


@inlined_expression
def divide_lane(w: Any, lane: Any, at: Any, factor: Any, to: Any) -> None:
    """Write the factors by which the mixer of one lane divides thrusts."""
    asked = read_record(w, to.command, lane, at)
    divided = Command(asked.torque_Nm, asked.difference_us, factor, asked.pwm_us)
    write_record(w, to.command, lane, at, divided)


@inlined_expression
def drive_lane(w: Any, lane: Any, at: Any, now: Any, to: Any) -> None:
    """Write the setpoint of one lane, and the pulses of the schedule as its command."""
    write_record(w, to.setpoint, lane, at, now.wanted.setpoint)
    asked = read_record(w, to.command, lane, at)
    driven = Command(asked.torque_Nm, asked.difference_us, asked.factor, now.wanted.pwm_us)
    write_record(w, to.command, lane, at, driven)


@inlined_expression
def expect_lane(w: Any, lane: Any, at: Any, now: Any, to: Any, hooks: Any) -> None:
    """Work out the factors that the feedforward of one lane divides by."""
    nominal, wanted, discs = read_record(w, to.nominal, lane, at), now.wanted, now.fixed
    body, seen = read_record(w, to.body, lane, at), read_record(w, to.readings, lane, at)
    p = read_record(w, to.nominal_effects, lane, at)
    plane = plane_below(wanted.nominal_plate_z_m, seen.theta_rad, hooks.tilt(p))
    heights = heights_over(plane, discs.x_m, discs.y_m)
    areas = scaled(body.covered, wanted.nominal_share)
    flow = hooks.bare(
        nominal.radius_m, discs.x_m, discs.y_m, plane, heights, areas, heights, now.time_s,
        seen.theta_rad,
    )  # fmt: skip
    factor = hooks.factors(hooks.with_images(flow, discs.distances_m, discs.body, p), p)
    for i in range(len(factor)):
        factor = with_fields(factor, i, expected_factor(factor[i], nominal.strength))
    divide_lane(w, lane, at, factor, to)


@inlined_expression
def mix_lane(w: Any, lane: Any, at: Any, now: Any, to: Any) -> None:
    """Write one lane's setpoint; share torque and collective out as whole pulses within limits."""
    write_record(w, to.setpoint, lane, at, now.wanted.setpoint)
    command, nominal = read_record(w, to.command, lane, at), read_record(w, to.nominal, lane, at)
    setpoint, limits = now.wanted.setpoint, read_record(w, to.limits, lane, at)
    x, pulses, pwm_us = now.fixed.x_m, nominal.pulses, command.pwm_us
    for i in range(len(x)):
        wanted = setpoint.collective_N - x[i] / now.fixed.span_m2 * command.torque_Nm
        asked = compensated_thrust(wanted, command.factor[i])
        speed = speed_from_thrust(asked, nominal.k)
        pwm = pwm_from_speed(speed, pulses.slope_rad_s_per_us, pulses.start_us, 1.0, 1.0)
        pwm = pwm - np.sign(x[i]) * (command.difference_us + now.wanted.dither_us)
        pwm = np.minimum(np.maximum(pwm, limits.least_us), limits.most_us)
        pwm_us = with_fields(pwm_us, i, rounded(pwm, limits.quantum_us))
    mixed = Command(command.torque_Nm, command.difference_us, command.factor, pwm_us)
    write_record(w, to.command, lane, at, mixed)


@inlined_expression
def turn_lane(w: Any, lane: Any, at: Any, now: Any, to: Any, hooks: Any) -> None:
    """Turn the pulses of one lane into the speeds that its rotors will settle at."""
    discs, time_s = now.fixed, now.time_s
    command, pulses = read_record(w, to.command, lane, at), read_record(w, to.pulses, lane, at)
    targets, body = read_record(w, to.targets, lane, at), read_record(w, to.body, lane, at)
    slope, start, settled = pulses.slope_rad_s_per_us, pulses.start_us, targets.sent_rad_s
    for i in range(len(settled)):
        speed = speed_from_pwm(command.pwm_us[i], slope, start, 1.0, 1.0)
        settled = with_fields(settled, i, speed)
    flow = hooks.bare(body.radius_m, discs.x_m, discs.y_m, LEVEL, settled, settled, settled, time_s)
    given = hooks.speeds(flow, read_record(w, to.effects, lane, at))
    write_record(w, to.targets, lane, at, Targets(given, given, given))


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
    wanted = inlined_expression(
        lambda a, tick: read_record(a.schedule, planned, tick, a.schedule.shape[1])
    )
    shown = inlined_expression(
        lambda a, tick: read_record(a.schedule, logged, tick, a.schedule.shape[1])
    )

    @inlined_expression
    def control(a: Any, now: Any) -> None:
        for lane in range(lanes):
            control_lane(a.w, lane, lanes, now, to, step)

    @inlined_expression
    def correct(a: Any, now: Any) -> None:
        by = read_record(a.gains, GAINS, 0, 1)
        for lane in range(lanes):
            correct_lane(a.w, lane, lanes, now, by, to, hooks())

    @inlined_expression
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

    @inlined_expression
    def drive(a: Any, now: Any) -> None:
        for lane in range(lanes):
            drive_lane(a.w, lane, lanes, now, to)
        for lane in range(lanes):
            turn_lane(a.w, lane, lanes, now, to, hooks())

    @inlined_expression
    def move(a: Any, now: Any) -> None:
        for lane in range(lanes):
            step_lane(a.w, lane, lanes, a.states, now, to, hooks())

    @inlined_expression
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

    closed: Any = expression(lambda: Phases(fixed, wanted, control, mix, move, sense, always_true))
    along: Any = expression(
        lambda: Phases(fixed, shown, correct, drive, move, no_phase, always_true)
    )
    key = repr((n_discs, lanes, rules, identity(step), layout.records, identities(effects)))

    def run(arrays: Any, plan: Any, first: Any, last: Any) -> Any:
        return run_ticks(shared_view(arrays, like), plan, first, last, build, closed())

    def filter_(arrays: Any, plan: Any, first: Any, last: Any) -> Any:
        return run_ticks(shared_view(arrays, like), plan, first, last, build, along())

    return PitchLoops(compiled_closure(run, key), compiled_closure(filter_, key))
