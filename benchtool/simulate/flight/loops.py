"""Loops of a flight for a set of effects, a law, and numbers of discs and rotors."""

from __future__ import annotations

import math
from collections import namedtuple
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.physics.disc_thrust import ImageRules, bound_hooks
from benchtool.physics.effects.effect import Effect
from benchtool.physics.expression import (
    Slot,
    expression,
    inlined_expression,
    read_record,
    with_fields,
    write_record,
)
from benchtool.physics.fold import chain_hooks, source_key, unrolled
from benchtool.physics.images import LEVEL
from benchtool.physics.rotor import drag_torque_Nm, ground_effect_thrust_N, speed_from_thrust
from benchtool.simulate.controllers.blocks import compensated_thrust, expected_factor
from benchtool.simulate.controllers.controller import (
    FlightCommand,
    FlightMeasurement,
    FlightReference,
)
from benchtool.simulate.flight.environment import Tables
from benchtool.simulate.flight.ground import build_look_below
from benchtool.simulate.flight.vehicle import (
    FlightGeometry,
    apply_impulse,
    drift,
    pitch_angle,
    rates_after_impulse,
    roll_angle,
    upward,
    yaw_angle,
)
from benchtool.simulate.hooks import Rotors, Targets, first_order_lag, identities, joined_hooks
from benchtool.simulate.layout import COUNTS, LINE, PLANE, SOLID, Layout
from benchtool.simulate.loop import Build, Phases, compile_loop
from benchtool.simulate.noise import next_state, normal

GOING, STRUCK, LOST = 0.0, 1.0, 2.0  # flying; touched a surface; state not finite

# Use of the map: strength and start time of the feedforward, 1 if a disc is covered as a whole or
# not at all, 1 if the map is used.
MapUse = namedtuple("MapUse", "strength from_s whole_discs is_used", defaults=(0.0, 0.0, 0.0, 0.0))

FlightTick = namedtuple(  # one column of the schedule: setpoint and current goal (m)
    "FlightTick",
    "reference goal_x_m goal_y_m goal_z_m",
    defaults=(FlightReference(0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 0.0, 0.0, 0.0),
)

GustRow = namedtuple(  # gust of 1 - cos shape: start (s), duration (s), peak velocity (m/s)
    "GustRow",
    "from_s length_s wind_x_m_s wind_y_m_s wind_z_m_s",
    defaults=(0.0, 0.0, 0.0, 0.0, 0.0),
)

# Noise of the gyro reading in a control period.
GyroNoise = namedtuple("GyroNoise", "p_rad_s q_rad_s r_rad_s", defaults=(0.0, 0.0, 0.0))

FlightOutcome = namedtuple(  # ending, plant steps with a clamped height, least height of a disc (m)
    "FlightOutcome", "ending clamped_steps nearest_m", defaults=(GOING, 0.0, float("inf"))
)

# Torques by ground effect, for the log.
GroundTorque = namedtuple("GroundTorque", "roll_Nm pitch_Nm", defaults=(0.0, 0.0))

TICK, GUST, NOISE = Slot(0, FlightTick()), Slot(0, GustRow()), Slot(0, GyroNoise())


class FlightArrays(NamedTuple):
    """Arrays of a flight.

    Attributes:
        w: the records.
        sent: ring buffer of commanded speeds (n_rotors, n_ring, 1).
        log: (n_rows, n_logged, 1), the rows `logged` of `w`.
        schedule: (n_numbers, n_ticks), a `FlightTick` per column.
        noise: (3, n_ticks), a `GyroNoise` per column; or one column for all ticks.
        gusts: (n_numbers, n_gusts), a `GustRow` per column.
        scratch: a column of `ground.DISC` per disc.
        geometry: a `FlightGeometry` (n_numbers,).
        plan: a `LoopPlan` (n_settings,).
        below, map: tables of the environment, and of its map.
    """

    w: Array = LINE
    states: NDArray[np.int64] = COUNTS
    sent: Array = SOLID
    log: Array = SOLID
    logged: NDArray[np.int64] = COUNTS
    schedule: Array = PLANE
    noise: Array = PLANE
    gusts: Array = PLANE
    scratch: Array = PLANE
    geometry: Array = LINE
    plan: NDArray[np.int64] = COUNTS
    below: Tables = Tables()
    map: Tables = Tables()


# Loops of a flight: run, see `compile_loop`; and look_below, see `ground.build_look_below`.
FlightLoops = namedtuple("FlightLoops", "run look_below")


@inlined_expression
def control_vehicle(arrays: Any, now: Any, slots: Any, law: Any) -> None:
    """Run one step of the built-in law, with its state in the records."""
    w, measured = arrays.w, read_record(arrays.w, slots.measured, 0, 1)
    map_use, expected = read_record(w, slots.map_use, 0, 1), read_record(w, slots.expected, 0, 1)
    p, state = read_record(w, slots.law, 0, 1), read_record(w, slots.law_state, 0, 1)
    state, command = law(
        p, state, measured, now.scheduled.reference, now.plan.substeps * now.geometry.dt_s
    )
    write_record(w, slots.law_state, 0, 1, state)
    factor = expected.factor
    for i in range(len(factor)):
        map_factor = factor[i] if measured.time_s >= map_use.from_s else 1.0
        factor = with_fields(factor, i, expected_factor(map_factor, map_use.strength))
    next_command = FlightCommand(
        command.thrust_N, command.roll_Nm, command.pitch_Nm, command.yaw_Nm, factor
    )
    write_record(w, slots.command, 0, 1, next_command)


@inlined_expression
def mix_vehicle(
    arrays: Any, now: Any, slots: Any, hooks: Any, rotor_speeds: Any, rotor_disc: Any
) -> None:  # fmt: skip
    """Allocate thrust and torques to rotor speeds; log the torques by ground effect."""
    w, command = arrays.w, read_record(arrays.w, slots.command, 0, 1)
    craft, p = read_record(w, slots.craft, 0, 1), read_record(w, slots.effects, 0, 1)
    write_record(w, slots.scheduled, 0, 1, now.scheduled)
    speeds = craft.x_m
    for i in range(len(speeds)):
        thrust = craft.per_thrust[i] * command.thrust_N + craft.per_roll[i] * command.roll_Nm
        thrust += craft.per_pitch[i] * command.pitch_Nm + craft.per_yaw[i] * command.yaw_Nm
        compensated_N = compensated_thrust(thrust, command.divide_by[rotor_disc[i]])
        speed = min(speed_from_thrust(compensated_N, craft.k_N_s2), craft.top_speed_rad_s)
        speeds = with_fields(speeds, i, speed)
    flow = hooks.bare(
        craft.effective_radius_m, craft.x_m, craft.y_m, LEVEL, speeds, speeds, speeds, now.time_s
    )
    target = rotor_speeds(flow, p)
    write_record(w, slots.targets, 0, 1, Targets(target, target, target))
    if now.tick == 0:  # initial hover, without other commands in the delay
        write_record(w, slots.rotors, 0, 1, Rotors(target))
        for i in range(len(target)):
            for position in range(arrays.sent.shape[1]):
                arrays.sent[i, position, 0] = target[i]
    if now.tick % now.plan.log_every == 0:
        speeds = read_record(w, slots.rotors, 0, 1).speed_rad_s
        factor = read_record(w, slots.below, 0, 1).factor
        roll, pitch = 0.0, 0.0
        for i in range(len(speeds)):
            added_N = ground_effect_thrust_N(speeds[i], craft.k_N_s2, factor[rotor_disc[i]] - 1.0)
            roll += craft.y_m[i] * added_N
            pitch -= craft.x_m[i] * added_N
        write_record(w, slots.ground, 0, 1, GroundTorque(roll, pitch))


@expression
def disc_speeds(speeds: Any, ones: Any, rotor_disc: Any) -> Any:
    """Return the root of the summed squared rotor speeds of each disc: rad/s."""
    speed = ones
    for i in range(len(ones)):
        speed = with_fields(speed, i, 0.0 * ones[i])
    for j in range(len(speeds)):
        i = rotor_disc[j]
        speed = with_fields(speed, i, speed[i] + speeds[j] * speeds[j])
    for i in range(len(ones)):
        speed = with_fields(speed, i, np.sqrt(speed[i]))
    return speed


@inlined_expression
def wind_velocity(time_s: Any, gusts: Any) -> Any:
    """Return the wind velocity (3,): m/s."""
    x, y, z = 0.0, 0.0, 0.0
    for g in range(gusts.shape[1]):
        gust = read_record(gusts, GUST, g, gusts.shape[1])
        elapsed_s = time_s - gust.from_s
        if 0.0 < elapsed_s < gust.length_s:
            share = 0.5 * (1.0 - math.cos(2.0 * math.pi * elapsed_s / gust.length_s))
            x += gust.wind_x_m_s * share
            y += gust.wind_y_m_s * share
            z += gust.wind_z_m_s * share
    return x, y, z


@inlined_expression
def next_velocity(time_s: Any, body: Any, lift_N: Any, craft: Any, gusts: Any, dt_s: Any) -> Any:
    """Return the velocity (3,) after a step; drag acts at the mean of old and new velocity."""
    up_x, up_y, up_z = upward(body)
    ax, ay = lift_N * up_x / craft.mass_kg, lift_N * up_y / craft.mass_kg
    az = lift_N * up_z / craft.mass_kg - craft.gravity_m_s2
    vx, vy, vz = body.vx_m_s, body.vy_m_s, body.vz_m_s
    if craft.drag_N_s_m > 0.0:
        half = 0.5 * dt_s * craft.drag_N_s_m / craft.mass_kg
        wind_x, wind_y, wind_z = wind_velocity(time_s, gusts)
        vx = ((1.0 - half) * vx + (dt_s * ax + 2.0 * half * wind_x)) / (1.0 + half)
        vy = ((1.0 - half) * vy + (dt_s * ay + 2.0 * half * wind_y)) / (1.0 + half)
        vz = ((1.0 - half) * vz + (dt_s * az + 2.0 * half * wind_z)) / (1.0 + half)
    else:
        vx, vy, vz = vx + dt_s * ax, vy + dt_s * ay, vz + dt_s * az
    return vx, vy, vz


@inlined_expression
def move_vehicle(
    arrays: Any, now: Any, slots: Any, hooks: Any, look_below: Any, rotor_disc: Any, ones: Any
) -> None:  # fmt: skip
    """Advance one plant step by drift-kick-drift, with the forces at mid-step."""
    w, discs, dt_s = arrays.w, now.geometry, now.geometry.dt_s
    craft, motion = read_record(w, slots.craft, 0, 1), read_record(w, slots.motion, 0, 1)
    p, targets = read_record(w, slots.effects, 0, 1), read_record(w, slots.targets, 0, 1)
    outcome = read_record(w, slots.outcome, 0, 1)
    old, new = targets.old_rad_s, targets.new_rad_s
    start_rad_s = read_record(w, slots.rotors, 0, 1).speed_rad_s
    middle_rad_s = first_order_lag(motion.first, start_rad_s, old, new)
    end_rad_s = first_order_lag(motion.second, middle_rad_s, old, new)
    write_record(w, slots.rotors, 0, 1, Rotors(end_rad_s))

    time_s = now.time_s + (now.part + 0.5) * dt_s
    body = drift(read_record(w, slots.body, 0, 1), 0.5 * dt_s)
    speed, pitch = disc_speeds(middle_rad_s, ones, rotor_disc), pitch_angle(body)
    below, flow = look_below(
        time_s, pitch, body, craft, discs, speed, p, arrays.below, 0.0, arrays.scratch
    )
    lift, roll, pitching, yaw = 0.0, 0.0, 0.0, 0.0
    for i in range(len(middle_rad_s)):
        thrust = ground_effect_thrust_N(middle_rad_s[i], craft.k_N_s2, below.factor[rotor_disc[i]])
        lift += thrust
        roll += craft.y_m[i] * thrust
        pitching -= craft.x_m[i] * thrust
        drag = drag_torque_Nm(middle_rad_s[i], craft.c_Nm_s2)
        yaw -= craft.spin[i] * drag * below.drag[rotor_disc[i]]
    pitching += body.wake_Nm
    rate, rate_per_torque = body.q_rad_s, dt_s / craft.inertia_kgm2[1]
    flow = hooks.bare(
        craft.effective_radius_m, discs.x_m, discs.y_m, flow.plane, flow.height_m, flow.coverage,
        speed, time_s, pitch, rate, weight_N=lift,
    )  # fmt: skip
    flow = hooks.with_thrust(flow, rate, craft.k_N_s2, below.factor)
    middle_rate = rate + 0.5 * rate_per_torque * (pitching + hooks.torque(0, flow, p))
    flow = hooks.with_thrust(flow, middle_rate, craft.k_N_s2, below.factor)
    torque = (roll, pitching + hooks.torque(0, flow, p), yaw)
    wake = motion.wake_decay * body.wake_Nm
    if motion.wake_innovation_Nm > 0.0:
        first = next_state(arrays.states[0])
        arrays.states[0] = next_state(first)
        wake += motion.wake_innovation_Nm * normal(first, arrays.states[0])
    velocity = next_velocity(time_s, body, lift, craft, arrays.gusts, dt_s)
    rates = rates_after_impulse(body, torque, craft.inertia_kgm2, dt_s)
    body = drift(apply_impulse(body, velocity, rates, wake), 0.5 * dt_s)

    ending = outcome.ending
    if not math.isfinite(body.x_m + body.y_m + body.z_m + body.qw + body.p_rad_s + body.q_rad_s):
        ending = LOST
    if below.touching > 0.0:
        ending = STRUCK
    write_record(w, slots.body, 0, 1, body)
    nearest = min(outcome.nearest_m, below.nearest_m)
    outcome = FlightOutcome(ending, outcome.clamped_steps + below.clamped, nearest)
    write_record(w, slots.outcome, 0, 1, outcome)


@inlined_expression
def sense_vehicle(
    arrays: Any, now: Any, slots: Any, hooks: Any, look_below: Any, rotor_disc: Any, ones: Any
) -> None:
    """Measure the state; evaluate the map below if used, and the true surfaces if logged."""
    w, body = arrays.w, read_record(arrays.w, slots.body, 0, 1)
    craft, map_use = read_record(w, slots.craft, 0, 1), read_record(w, slots.map_use, 0, 1)
    p, outcome = read_record(w, slots.effects, 0, 1), read_record(w, slots.outcome, 0, 1)
    speeds = read_record(w, slots.rotors, 0, 1).speed_rad_s
    discs, time_s = now.geometry, now.time_s
    speed, pitch = disc_speeds(speeds, ones, rotor_disc), pitch_angle(body)
    for on_map in range(2):
        if on_map > 0:
            is_due, tables, whole = map_use.is_used > 0.0, arrays.map, map_use.whole_discs
            is_due = is_due and time_s >= map_use.from_s
        else:
            is_due, tables, whole = now.tick % now.plan.log_every == 0, arrays.below, 0.0
        if is_due:
            below, _ = look_below(
                time_s, pitch, body, craft, discs, speed, p, tables, whole, arrays.scratch
            )
            if on_map > 0:
                write_record(w, slots.expected, 0, 1, below)
            else:
                write_record(w, slots.below, 0, 1, below)
                nearest = min(outcome.nearest_m, below.nearest_m)
                next_outcome = FlightOutcome(outcome.ending, outcome.clamped_steps, nearest)
                write_record(w, slots.outcome, 0, 1, next_outcome)
    expected = read_record(w, slots.expected, 0, 1)
    n_noise = arrays.noise.shape[1]
    noise = read_record(arrays.noise, NOISE, min(now.tick, n_noise - 1), n_noise)
    gyro = hooks.gyro(time_s, pitch, body.q_rad_s, 0.0, p)
    measured = FlightMeasurement(
        time_s, body.x_m, body.y_m, body.z_m, body.vx_m_s, body.vy_m_s, body.vz_m_s,
        roll_angle(body), pitch, yaw_angle(body), body.p_rad_s + noise.p_rad_s,
        gyro + noise.q_rad_s, body.r_rad_s + noise.r_rad_s, expected.height_m, expected.coverage,
    )  # fmt: skip
    write_record(w, slots.measured, 0, 1, measured)


@lru_cache(maxsize=64)
def flight_loops(
    effects: tuple[Effect, ...],
    layout: Layout,
    rotor_disc: tuple[int, ...],
    geometry_type: FlightGeometry,
    rules: ImageRules,
    step: Any,
) -> FlightLoops:
    """Return the loops for these effects and this law; `geometry_type` contains zeros."""
    n, slots = len(geometry_type.x_m), layout.slots
    ones, n_rotors, hooks = (1.0,) * n, len(rotor_disc), joined_hooks(effects, n, rules)
    look_below = build_look_below(n, hooks)
    change_speed = chain_hooks(bound_hooks(effects, "speed"))
    rotor_speeds = unrolled(
        n_rotors, expression(lambda i, flow, p: change_speed(i, flow.speed_rad_s[i], flow, p))
    )
    law = inlined_expression(lambda arrays, now: control_vehicle(arrays, now, slots, step))
    mix = inlined_expression(
        lambda arrays, now: mix_vehicle(arrays, now, slots, hooks(), rotor_speeds, rotor_disc)
    )
    move = inlined_expression(
        lambda arrays, now: move_vehicle(arrays, now, slots, hooks(), look_below, rotor_disc, ones)
    )
    sense = inlined_expression(
        lambda arrays, now: sense_vehicle(arrays, now, slots, hooks(), look_below, rotor_disc, ones)
    )
    is_running = inlined_expression(
        lambda arrays: read_record(arrays.w, slots.outcome, 0, 1).ending == GOING
    )
    phases: Any = expression(lambda: Phases(law, mix, move, sense, is_running))
    key = repr(
        (rotor_disc, rules, source_key(step), layout.key, geometry_type, identities(effects))
    )
    build = Build((0,), slots, Slot(0, geometry_type), TICK)
    return FlightLoops(compile_loop(FlightArrays(), build, phases, key), look_below)
