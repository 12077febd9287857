"""The loops of a flight, made for a set of effects, a law, and numbers of discs and rotors."""

from __future__ import annotations

import math
from collections import namedtuple
from functools import lru_cache
from typing import Any

import numpy as np

from benchtool.physics.disc_thrust import ImageRules, bound_hooks
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
from benchtool.physics.fold import chained, identity, unrolled
from benchtool.physics.rotor import drag_torque_Nm, ground_effect_thrust_N, speed_from_thrust
from benchtool.physics.tilt import LEVEL
from benchtool.simulate.controllers.controller import FlightCommand, FlightMeasurement
from benchtool.simulate.controllers.feedforward import compensated_thrust, expected_factor
from benchtool.simulate.flight.ground import surround
from benchtool.simulate.flight.records import (
    GOING,
    GUST,
    LOST,
    NOISE,
    STRUCK,
    TICK,
    FlightArrays,
    FlightOutcome,
    GroundTorque,
    geometry_slot,
)
from benchtool.simulate.flight.rigid_body import (
    apply_impulse,
    drift,
    pitch_of,
    rates_after_impulse,
    roll_of,
    upward,
    yaw_of,
)
from benchtool.simulate.hooks import identities, joined_hooks
from benchtool.simulate.kernel import Build, Phases, run_ticks
from benchtool.simulate.layout import Layout
from benchtool.simulate.motors import Rotors, Targets, first_order_lag
from benchtool.simulate.noise import next_state, normal

FlightLoops = namedtuple("FlightLoops", "run look")
"""Hold what a flight runs: run(arrays, plan, first, last) -> the tick at which it ended, with
the arrays as `layout.lend_rows`; and look, see `ground.surround`.
"""


@inlined_expression
def control_vehicle(a: Any, now: Any, to: Any, law: Any) -> None:
    """Run a built-in law: a controller's step, with its state in the vehicle's records."""
    w, measured = a.w, read_record(a.w, to.measured, 0, 1)
    chart, expected = read_record(w, to.chart, 0, 1), read_record(w, to.expected, 0, 1)
    p, state = read_record(w, to.law, 0, 1), read_record(w, to.law_state, 0, 1)
    state, command = law(
        p, state, measured, now.wanted.reference, now.plan.substeps * now.fixed.dt_s
    )
    write_record(w, to.law_state, 0, 1, state)
    factor = expected.factor
    for i in range(len(factor)):
        known = factor[i] if measured.time_s >= chart.from_s else 1.0
        factor = with_fields(factor, i, expected_factor(known, chart.strength))
    asked = FlightCommand(
        command.thrust_N, command.roll_Nm, command.pitch_Nm, command.yaw_Nm, factor
    )
    write_record(w, to.command, 0, 1, asked)


@inlined_expression
def mix_vehicle(
    a: Any, now: Any, to: Any, hooks: Any, rotor_speeds: Any, disc_of: Any
) -> None:  # fmt: skip
    """Share thrust and torques out to the rotors as speeds; log what the ground adds to these."""
    w, command = a.w, read_record(a.w, to.command, 0, 1)
    craft, p = read_record(w, to.craft, 0, 1), read_record(w, to.effects, 0, 1)
    write_record(w, to.wanted, 0, 1, now.wanted)
    speeds = craft.x_m
    for i in range(len(speeds)):
        thrust = craft.per_thrust[i] * command.thrust_N + craft.per_roll[i] * command.roll_Nm
        thrust += craft.per_pitch[i] * command.pitch_Nm + craft.per_yaw[i] * command.yaw_Nm
        wanted_N = compensated_thrust(thrust, command.divide_by[disc_of[i]])
        speed = min(speed_from_thrust(wanted_N, craft.k_N_s2), craft.top_speed_rad_s)
        speeds = with_fields(speeds, i, speed)
    flow = hooks.bare(
        craft.effective_radius_m, craft.x_m, craft.y_m, LEVEL, speeds, speeds, speeds, now.time_s
    )
    given = rotor_speeds(flow, p)
    write_record(w, to.targets, 0, 1, Targets(given, given, given))
    if now.tick == 0:  # it hovers when it begins, with no other command on its way
        write_record(w, to.rotors, 0, 1, Rotors(given))
        for i in range(len(given)):
            for place in range(a.sent.shape[1]):
                a.sent[i, place, 0] = given[i]
    if now.tick % now.plan.log_every == 0:
        speeds = read_record(w, to.rotors, 0, 1).speed_rad_s
        factor = read_record(w, to.below, 0, 1).factor
        roll, pitch = 0.0, 0.0
        for i in range(len(speeds)):
            added = ground_effect_thrust_N(speeds[i], craft.k_N_s2, factor[disc_of[i]] - 1.0)
            roll += craft.y_m[i] * added
            pitch -= craft.x_m[i] * added
        write_record(w, to.ground, 0, 1, GroundTorque(roll, pitch))


@expression
def disc_speeds(speeds: Any, ones: Any, disc_of: Any) -> Any:
    """Return the root of the summed squares of each disc's rotors: rad/s."""
    found = ones
    for i in range(len(ones)):
        found = with_fields(found, i, 0.0 * ones[i])
    for j in range(len(speeds)):
        i = disc_of[j]
        found = with_fields(found, i, found[i] + speeds[j] * speeds[j])
    for i in range(len(ones)):
        found = with_fields(found, i, np.sqrt(found[i]))
    return found


@inlined_expression
def blown(time_s: Any, gusts: Any) -> Any:
    """Return the wind (3,): m/s."""
    x, y, z = 0.0, 0.0, 0.0
    for g in range(gusts.shape[1]):
        gust = read_record(gusts, GUST, g, gusts.shape[1])
        since = time_s - gust.from_s
        if 0.0 < since < gust.length_s:
            share = 0.5 * (1.0 - math.cos(2.0 * math.pi * since / gust.length_s))
            x += gust.wind_x_m_s * share
            y += gust.wind_y_m_s * share
            z += gust.wind_z_m_s * share
    return x, y, z


@inlined_expression
def pushed(time_s: Any, body: Any, lift_N: Any, craft: Any, gusts: Any, dt_s: Any) -> Any:
    """Return the velocity (3,) a step on; drag is taken at the mean of old and new velocity."""
    up_x, up_y, up_z = upward(body)
    ax, ay = lift_N * up_x / craft.mass_kg, lift_N * up_y / craft.mass_kg
    az = lift_N * up_z / craft.mass_kg - craft.gravity_m_s2
    vx, vy, vz = body.vx_m_s, body.vy_m_s, body.vz_m_s
    if craft.drag_N_s_m > 0.0:
        half = 0.5 * dt_s * craft.drag_N_s_m / craft.mass_kg
        wind_x, wind_y, wind_z = blown(time_s, gusts)
        vx = ((1.0 - half) * vx + (dt_s * ax + 2.0 * half * wind_x)) / (1.0 + half)
        vy = ((1.0 - half) * vy + (dt_s * ay + 2.0 * half * wind_y)) / (1.0 + half)
        vz = ((1.0 - half) * vz + (dt_s * az + 2.0 * half * wind_z)) / (1.0 + half)
    else:
        vx, vy, vz = vx + dt_s * ax, vy + dt_s * ay, vz + dt_s * az
    return vx, vy, vz


@inlined_expression
def move_vehicle(
    a: Any, now: Any, to: Any, hooks: Any, look: Any, disc_of: Any, ones: Any
) -> None:  # fmt: skip
    """Fly one plant step: half of the way, the forces found there, the other half."""
    w, discs, dt_s = a.w, now.fixed, now.fixed.dt_s
    craft, motion = read_record(w, to.craft, 0, 1), read_record(w, to.motion, 0, 1)
    p, targets = read_record(w, to.effects, 0, 1), read_record(w, to.targets, 0, 1)
    outcome = read_record(w, to.outcome, 0, 1)
    old, new = targets.old_rad_s, targets.new_rad_s
    middle_rad_s = first_order_lag(
        motion.first, read_record(w, to.rotors, 0, 1).speed_rad_s, old, new
    )
    write_record(w, to.rotors, 0, 1, Rotors(first_order_lag(motion.second, middle_rad_s, old, new)))

    time_s = now.time_s + (now.part + 0.5) * dt_s
    body = drift(read_record(w, to.body, 0, 1), 0.5 * dt_s)
    speed, pitch = disc_speeds(middle_rad_s, ones, disc_of), pitch_of(body)
    found, flow = look(time_s, pitch, body, craft, discs, speed, p, a.below, 0.0, a.scratch)
    lift, roll, pitching, yaw = 0.0, 0.0, 0.0, 0.0
    for i in range(len(middle_rad_s)):
        thrust = ground_effect_thrust_N(middle_rad_s[i], craft.k_N_s2, found.factor[disc_of[i]])
        lift += thrust
        roll += craft.y_m[i] * thrust
        pitching -= craft.x_m[i] * thrust
        drag = drag_torque_Nm(middle_rad_s[i], craft.c_Nm_s2)
        yaw -= craft.spin[i] * drag * found.drag[disc_of[i]]
    pitching += body.wake_Nm
    rate, share = body.q_rad_s, dt_s / craft.inertia_kgm2[1]
    flow = hooks.bare(
        craft.effective_radius_m, discs.x_m, discs.y_m, flow.plane, flow.height_m, flow.coverage,
        speed, time_s, pitch, rate, weight_N=lift,
    )  # fmt: skip
    flow = hooks.with_thrust(flow, rate, craft.k_N_s2, found.factor)
    middle = rate + 0.5 * share * (pitching + hooks.torque(0, flow, p))
    flow = hooks.with_thrust(flow, middle, craft.k_N_s2, found.factor)
    torque = (roll, pitching + hooks.torque(0, flow, p), yaw)
    wake = motion.wake_remains * body.wake_Nm
    if motion.wake_kick_Nm > 0.0:
        first = next_state(a.states[0])
        a.states[0] = next_state(first)
        wake += motion.wake_kick_Nm * normal(first, a.states[0])
    velocity = pushed(time_s, body, lift, craft, a.gusts, dt_s)
    rates = rates_after_impulse(body, torque, craft.inertia_kgm2, dt_s)
    body = drift(apply_impulse(body, velocity, rates, wake), 0.5 * dt_s)

    ending = outcome.ending
    if not math.isfinite(body.x_m + body.y_m + body.z_m + body.qw + body.p_rad_s + body.q_rad_s):
        ending = LOST
    if found.touching > 0.0:
        ending = STRUCK
    write_record(w, to.body, 0, 1, body)
    nearest = min(outcome.nearest_m, found.nearest_m)
    outcome = FlightOutcome(ending, outcome.held_steps + found.held, nearest)
    write_record(w, to.outcome, 0, 1, outcome)


@inlined_expression
def sense_vehicle(
    a: Any, now: Any, to: Any, hooks: Any, look: Any, disc_of: Any, ones: Any
) -> None:
    """Read the state and the gyro at the beginning of a tick, and look below: on the map where it
    is read, at what is there where the tick is logged.
    """
    w, body = a.w, read_record(a.w, to.body, 0, 1)
    craft, chart = read_record(w, to.craft, 0, 1), read_record(w, to.chart, 0, 1)
    p, outcome = read_record(w, to.effects, 0, 1), read_record(w, to.outcome, 0, 1)
    speeds = read_record(w, to.rotors, 0, 1).speed_rad_s
    discs, time_s = now.fixed, now.time_s
    speed, pitch = disc_speeds(speeds, ones, disc_of), pitch_of(body)
    for on_map in range(2):
        if on_map > 0:
            due, tables, whole = chart.read > 0.0, a.chart, chart.whole
            due = due and time_s >= chart.from_s
        else:
            due, tables, whole = now.tick % now.plan.log_every == 0, a.below, 0.0
        if due:
            found, _ = look(time_s, pitch, body, craft, discs, speed, p, tables, whole, a.scratch)
            if on_map > 0:
                write_record(w, to.expected, 0, 1, found)
            else:
                write_record(w, to.below, 0, 1, found)
                nearest = min(outcome.nearest_m, found.nearest_m)
                seen = FlightOutcome(outcome.ending, outcome.held_steps, nearest)
                write_record(w, to.outcome, 0, 1, seen)
    expected = read_record(w, to.expected, 0, 1)
    n_noise = a.noise.shape[1]
    noise = read_record(a.noise, NOISE, min(now.tick, n_noise - 1), n_noise)
    gyro = hooks.gyro(time_s, pitch, body.q_rad_s, 0.0, p)
    measured = FlightMeasurement(
        time_s, body.x_m, body.y_m, body.z_m, body.vx_m_s, body.vy_m_s, body.vz_m_s,
        roll_of(body), pitch, yaw_of(body), body.p_rad_s + noise.p_rad_s, gyro + noise.q_rad_s,
        body.r_rad_s + noise.r_rad_s, expected.height_m, expected.coverage,
    )  # fmt: skip
    write_record(w, to.measured, 0, 1, measured)


@inlined_expression
def still_going(a: Any, to: Any) -> Any:
    """Return whether nothing has ended the flight."""
    return read_record(a.w, to.outcome, 0, 1).ending == GOING


@lru_cache(maxsize=64)
def flight_loops(
    effects: tuple[Effect, ...],
    layout: Layout,
    disc_of: tuple[int, ...],
    rules: ImageRules,
    step: Any,
) -> FlightLoops:
    """Return the loops of these effects and this law."""
    n, to = max(disc_of) + 1, layout.places
    ones, n_rotors, like = (1.0,) * n, len(disc_of), FlightArrays()
    hooks = joined_hooks(effects, n, rules)
    slot, build = geometry_slot(n, rules.n_body), Build((0,), to)
    look = surround(n, hooks)
    speed = chained(bound_hooks(effects, "speed"))
    rotor_speeds = unrolled(
        n_rotors, expression(lambda i, flow, p: speed(i, flow.speed_rad_s[i], flow, p))
    )
    fixed = expression(lambda a: read_record(a.geometry, slot, 0, 1))
    wanted = inlined_expression(
        lambda a, tick: read_record(a.schedule, TICK, tick, a.schedule.shape[1])
    )
    law = inlined_expression(lambda a, now: control_vehicle(a, now, to, step))
    mix = inlined_expression(lambda a, now: mix_vehicle(a, now, to, hooks(), rotor_speeds, disc_of))
    move = inlined_expression(lambda a, now: move_vehicle(a, now, to, hooks(), look, disc_of, ones))
    sense = inlined_expression(
        lambda a, now: sense_vehicle(a, now, to, hooks(), look, disc_of, ones)
    )
    goes_on = inlined_expression(lambda a: still_going(a, to))
    phases: Any = expression(lambda: Phases(fixed, wanted, law, mix, move, sense, goes_on))
    key = repr((disc_of, rules, identity(step), layout.records, identities(effects)))

    def run(arrays: Any, plan: Any, first: Any, last: Any) -> Any:
        return run_ticks(shared_view(arrays, like), plan, first, last, build, phases())

    return FlightLoops(compiled_closure(run, key), look)
