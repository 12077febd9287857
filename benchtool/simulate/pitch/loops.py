"""Loops of the pitch bench for a set of effects, a law, and numbers of discs and lanes.

All numbers of a run are in one block of floats, row by row with adjacent lanes: only then can a
compiler prove that rows do not overlap, and vectorise over lanes. A phase of the loop reads the
records that it needs and writes those that it changes.
"""

from __future__ import annotations

from collections import namedtuple
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.physics.body_lift import BodyImages
from benchtool.physics.disc_thrust import ImageRules
from benchtool.physics.effects.effect import Effect
from benchtool.physics.expression import (
    Slot,
    at_least,
    at_most,
    expression,
    inlined_expression,
    read_record,
    with_fields,
    write_record,
)
from benchtool.physics.fold import source_key
from benchtool.physics.images import LEVEL
from benchtool.physics.rotor import pwm_from_speed, speed_from_pwm, speed_from_thrust
from benchtool.simulate.controllers.blocks import compensated_thrust, expected_factor
from benchtool.simulate.controllers.controller import ControlLaw, PitchMeasurement, PitchReference
from benchtool.simulate.hooks import Targets, identities, joined_hooks
from benchtool.simulate.layout import COUNTS, LINE, PLANE, SOLID, Layout
from benchtool.simulate.loop import PULSES, Build, Phases, always_true, compile_loop, no_phase
from benchtool.simulate.noise import later_state
from benchtool.simulate.pitch.lane import (
    Delayed,
    FilterGains,
    Setpoint,
    correct_lane,
    heights_over,
    plane_below,
    rounded,
    scaled,
    sense_lane,
    step_lane,
)

PAST = 64  # longest sensor delay in control ticks; a power of two, see `PAST_MASK`
PAST_MASK = PAST - 1  # index of a tick in the ring of `PAST` ticks

Tick = namedtuple(
    "Tick", "setpoint nominal_plate_z_m nominal_share observer feedforward dither_us pwm_us"
)
"""One column of the schedule.

Attributes:
    nominal_plate_z_m, nominal_share: plate according to the map.
    observer, feedforward: 1 while enabled.
    dither_us: added to the pulse width of discs that push nose down.
    pwm_us: pulse width of each disc, where a log drives the bench.
"""

Fresh = namedtuple("Fresh", "theta gyro plate speed", defaults=(0.0, 0.0, 0.0, 0.0))  # new readings

# One column of a log: setpoint and pulse widths as in `Tick`, filter mode, and readings of
# pitch (rad), gyro (rad/s) and speed of each disc (rad/s); nan where there is none.
LoggedTick = namedtuple("LoggedTick", "setpoint pwm_us mode theta_rad gyro_rad_s speed_rad_s")

FRESH, GAINS = Slot(0, Fresh()), Slot(0, FilterGains())


class PitchArrays(NamedTuple):
    """Arrays of a run.

    Attributes:
        w: records of all lanes, flat: row times lanes plus lane.
        states: random number state of each lane (n_lanes,).
        sent: ring buffer of commanded speeds (n_discs, n_ring, n_lanes).
        past: ring buffer of true pitch, rate and plate distance (3, n_past, n_lanes).
        log: (n_ticks, n_logged, n_lanes), the rows `logged` of `w` at each tick.
        schedule: (n_rows, n_ticks), a `Tick` per column; for a filter `LoggedTick`.
        fresh: (n_sensors, n_ticks + 1), 1 for a new reading at a tick.
        geometry: a `Geometry` (n_numbers,).
        gains: `FilterGains` of a filter (n_gains,).
        plan: a `LoopPlan` (n_settings,).
    """

    w: Array = LINE
    states: NDArray[np.int64] = COUNTS
    sent: Array = SOLID
    past: Array = SOLID
    log: Array = SOLID
    logged: NDArray[np.int64] = COUNTS
    schedule: Array = PLANE
    fresh: Array = PLANE
    geometry: Array = LINE
    gains: Array = LINE
    plan: NDArray[np.int64] = COUNTS


def tick_slot(n_discs: int) -> Slot:
    """Return the slot of one column of a schedule."""
    return Slot(0, Tick(Setpoint(), 0.0, 0.0, 0.0, 0.0, 0.0, (0.0,) * n_discs))


class Geometry(NamedTuple):
    """Plant step; sum of the squared rotor arms; disc positions (n,); root of the number of rotors
    per disc (n,); distances between discs (n, n); sources of the body term (n_body,).
    """

    dt_s: Any
    span_m2: Any
    x_m: Any
    y_m: Any
    roots: Any
    distances_m: Any
    body: BodyImages


COLUMNS = {  # first columns of a log with their record fields
    "reference_rad": "setpoint.reference_rad",
    "theta_rad": "readings.theta_rad",
    "gyro_rad_s": "readings.gyro_rad_s",
    "plate_z_m": "setpoint.plate_z_m",
    "plate_read_m": "readings.plate_z_m",
    "plate_share": "setpoint.plate_share",
    "torque_Nm": "command.torque_Nm",
    "estimate_Nm": "law_state.estimate_Nm",
    "true_theta_rad": "hinge.theta_rad",
    "true_rate_rad_s": "hinge.rate_rad_s",
}

LOGGED = (*COLUMNS.values(), "pwm_us", "readings.speed_rad_s")  # fields of a log

# Compiled loops, see `compile_loop`: run, and filter along a log.
PitchLoops = namedtuple("PitchLoops", "run filter")


@inlined_expression
def control_lane(w: Any, lane: Any, lanes: Any, now: Any, slots: Any, law: Any) -> None:
    """Run one step of the built-in law of one lane, with its state in the records of the lane."""
    readings, scheduled = read_record(w, slots.readings, lane, lanes), now.scheduled
    theta_rad, gyro_rad_s, plate_z_m, speed_rad_s = readings
    state, command = law(
        read_record(w, slots.law, lane, lanes),
        read_record(w, slots.law_state, lane, lanes),
        PitchMeasurement(now.time_s, theta_rad, gyro_rad_s, plate_z_m, speed_rad_s),
        PitchReference(
            scheduled.setpoint.reference_rad, scheduled.setpoint.collective_N, scheduled.observer
        ),
        now.plan.substeps * now.geometry.dt_s,
    )
    write_record(w, slots.law_state, lane, lanes, state)
    write_record(w, slots.command, lane, lanes, command)


@inlined_expression
def expect_lane(w: Any, lane: Any, lanes: Any, now: Any, slots: Any, hooks: Any) -> None:
    """Write the expected factors for the feedforward of one lane."""
    discs, scheduled = now.geometry, now.scheduled
    body = read_record(w, slots.body, lane, lanes)
    readings = read_record(w, slots.readings, lane, lanes)
    p = read_record(w, slots.effects, lane, lanes)
    strength = read_record(w, slots.strength, lane, lanes)
    plane = plane_below(scheduled.nominal_plate_z_m, readings.theta_rad, hooks.tilt(p))
    heights = heights_over(plane, discs.x_m, discs.y_m)
    areas = scaled(body.covered, scheduled.nominal_share)
    flow = hooks.bare(
        body.radius_m, discs.x_m, discs.y_m, plane, heights, areas, heights, now.time_s,
        readings.theta_rad,
    )  # fmt: skip
    factor = hooks.factors(hooks.with_images(flow, discs.distances_m, discs.body, p), p)
    for i in range(len(factor)):
        factor = with_fields(factor, i, expected_factor(factor[i], strength))
    write_record(w, slots.factor, lane, lanes, factor)


@inlined_expression
def mix_lane(w: Any, lane: Any, lanes: Any, now: Any, slots: Any) -> None:
    """Allocate torque and collective of one lane to clipped pulse widths."""
    command = read_record(w, slots.command, lane, lanes)
    factor = read_record(w, slots.factor, lane, lanes)
    pulses = read_record(w, slots.pulses, lane, lanes)
    limits = read_record(w, slots.limits, lane, lanes)
    k, x, pwm_us = read_record(w, slots.body, lane, lanes).k, now.geometry.x_m, factor
    collective_N, span_m2 = now.scheduled.setpoint.collective_N, now.geometry.span_m2
    for i in range(len(x)):
        thrust_N = collective_N - x[i] / span_m2 * command.torque_Nm
        speed = speed_from_thrust(compensated_thrust(thrust_N, factor[i]), k)
        pwm = pwm_from_speed(speed, pulses.slope_rad_s_per_us, pulses.start_us, 1.0, 1.0)
        pwm = pwm - np.sign(x[i]) * (command.difference_us + now.scheduled.dither_us)
        pwm = at_most(at_least(pwm, limits.min_us), limits.max_us)
        pwm_us = with_fields(pwm_us, i, rounded(pwm, limits.quantum_us))
    write_record(w, slots.pwm_us, lane, lanes, pwm_us)


@inlined_expression
def turn_lane(w: Any, lane: Any, lanes: Any, now: Any, slots: Any, hooks: Any) -> None:
    """Write the steady rotor speeds for the pulse widths of one lane as targets."""
    discs, time_s = now.geometry, now.time_s
    pwm_us = read_record(w, slots.pwm_us, lane, lanes)
    pulses = read_record(w, slots.pulses, lane, lanes)
    body, steady = read_record(w, slots.body, lane, lanes), pwm_us
    for i in range(len(steady)):
        speed = speed_from_pwm(pwm_us[i], pulses.slope_rad_s_per_us, pulses.start_us, 1.0, 1.0)
        steady = with_fields(steady, i, speed)
    flow = hooks.bare(body.radius_m, discs.x_m, discs.y_m, LEVEL, steady, steady, steady, time_s)
    target = hooks.speeds(flow, read_record(w, slots.effects, lane, lanes))
    write_record(w, slots.targets, lane, lanes, Targets(target, target, target))


@lru_cache(maxsize=64)
def pitch_loops(
    effects: tuple[Effect, ...],
    layout: Layout,
    geometry_type: Geometry,
    lanes: int,
    rules: ImageRules,
    law: ControlLaw,
) -> PitchLoops:
    """Return the loops for these effects and this law; `geometry_type` contains zeros."""
    n_discs, slots = len(geometry_type.x_m), layout.slots
    ones, zeros = (1.0,) * n_discs, (0.0,) * n_discs
    build = Build(tuple(range(lanes)), slots, Slot(0, geometry_type), tick_slot(n_discs))
    logged = Slot(0, LoggedTick(Setpoint(), zeros, 0.0, 0.0, 0.0, zeros))
    hooks, step = joined_hooks(effects, n_discs, rules), law.step

    @inlined_expression
    def control(arrays: Any, now: Any) -> None:
        for lane in range(lanes):
            control_lane(arrays.w, lane, lanes, now, slots, step)

    @inlined_expression
    def correct(arrays: Any, now: Any) -> None:
        gains = read_record(arrays.gains, GAINS, 0, 1)
        for lane in range(lanes):
            correct_lane(arrays.w, lane, lanes, now, gains, slots, hooks())

    @inlined_expression
    def mix(arrays: Any, now: Any) -> None:
        w = arrays.w
        for lane in range(lanes):
            write_record(w, slots.setpoint, lane, lanes, now.scheduled.setpoint)
        if now.scheduled.feedforward > 0.0:
            for lane in range(lanes):
                expect_lane(w, lane, lanes, now, slots, hooks())
        else:
            for lane in range(lanes):
                write_record(w, slots.factor, lane, lanes, ones)
        if now.plan.driver == PULSES:
            for lane in range(lanes):
                write_record(w, slots.pwm_us, lane, lanes, now.scheduled.pwm_us)
        else:
            for lane in range(lanes):
                mix_lane(w, lane, lanes, now, slots)
        for lane in range(lanes):
            turn_lane(w, lane, lanes, now, slots, hooks())

    @inlined_expression
    def drive(arrays: Any, now: Any) -> None:
        for lane in range(lanes):
            write_record(arrays.w, slots.setpoint, lane, lanes, now.scheduled.setpoint)
            write_record(arrays.w, slots.pwm_us, lane, lanes, now.scheduled.pwm_us)
        for lane in range(lanes):
            turn_lane(arrays.w, lane, lanes, now, slots, hooks())

    @inlined_expression
    def move(arrays: Any, now: Any) -> None:
        for lane in range(lanes):
            step_lane(arrays.w, lane, lanes, arrays.states, now, slots, hooks())

    @inlined_expression
    def sense(arrays: Any, now: Any) -> None:
        w, position, plan = arrays.w, now.tick & PAST_MASK, now.plan
        for lane in range(lanes):
            hinge, plate = read_record(w, slots.hinge, lane, lanes), now.scheduled.setpoint
            arrays.past[0, position, lane] = hinge.theta_rad
            arrays.past[1, position, lane] = hinge.rate_rad_s
            arrays.past[2, position, lane] = plate.plate_z_m
        theta_index = (now.tick - plan.theta_delay) & PAST_MASK
        rate_index = (now.tick - plan.rate_delay) & PAST_MASK
        plate_index = (now.tick - plan.plate_delay) & PAST_MASK
        for lane in range(lanes):
            delayed = Delayed(
                arrays.past[0, theta_index, lane],
                arrays.past[1, rate_index, lane],
                arrays.past[2, plate_index, lane],
            )
            write_record(w, slots.delayed, lane, lanes, delayed)
        fresh = read_record(arrays.fresh, FRESH, now.tick, arrays.fresh.shape[1])
        if fresh.theta + fresh.gyro + fresh.plate + fresh.speed > 0.0:
            for lane in range(lanes):
                sense_lane(w, lane, lanes, arrays.states, fresh, now.time_s, slots, hooks())
        else:  # readings are unchanged; random numbers advance as with new readings
            for lane in range(lanes):
                arrays.states[lane] = later_state(arrays.states[lane], 2 * (3 + n_discs))

    control_phases: Any = expression(lambda: Phases(control, mix, move, sense, always_true))
    filter_phases: Any = expression(lambda: Phases(correct, drive, move, no_phase, always_true))
    key = repr((lanes, rules, source_key(step), layout.key, geometry_type, identities(effects)))
    return PitchLoops(
        compile_loop(PitchArrays(), build, control_phases, key),
        compile_loop(
            PitchArrays(), build._replace(scheduled=logged), filter_phases, f"filter {key}"
        ),
    )
