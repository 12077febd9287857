"""The compiled loop of a flight: control periods, plant ticks, a log."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from benchtool.core.array import Array
from benchtool.physics.expression import compiled, loop_part
from benchtool.physics.rotor import drag_torque_Nm, ground_effect_thrust_N
from benchtool.simulate.environment import Tables
from benchtool.simulate.flight.ground import (
    COVERAGE,
    FACTOR,
    HEIGHT,
    HELD,
    TOUCHES,
    Discs,
    look_down,
)
from benchtool.simulate.flight.law import (
    AT_X,
    AT_Y,
    COMMAND,
    DISC,
    ESTIMATE,
    SPIN,
    Airframe,
    Law,
    decide,
    sense,
    share_out,
)
from benchtool.simulate.flight.rigid_body import (
    drift,
    kick_angular,
    kick_linear,
    pitch_of,
    roll_of,
    yaw_of,
)

Plan = NDArray[np.int64]

GOING, STRUCK, LOST = 0, 1, 2
"""How a flight stands: nothing in its way, touched something, numbers no longer finite."""

FIRST, LAST, TICKS, LOG_EVERY, ROWS, HELD_TICKS, AT_GOAL, ENDING = range(8)
"""Places in a flight's plan: control periods to run from and to stop before, plant ticks in each,
periods between rows of the log; and what the loop counts: rows logged, ticks at which a height was
held, the goal that holds, how it stands."""

N_PLAN = 8

LOGGED = (
    "time_s", "x_m", "y_m", "z_m", "vx_m_s", "vy_m_s", "vz_m_s", "roll_rad", "pitch_rad",
    "yaw_rad", "p_rad_s", "q_rad_s", "r_rad_s", "roll_ref_rad", "pitch_ref_rad", "yaw_ref_rad",
    "roll_estimate_Nm", "pitch_estimate_Nm", "yaw_estimate_Nm", "force_z_estimate_N",
    "roll_ground_Nm", "pitch_ground_Nm", "x_goal_m", "y_goal_m", "z_goal_m",
)  # fmt: skip
"""First columns of a log; coverage, height and factor of every disc and the speed of every rotor
follow."""


@loop_part
def motors(state: Array, speeds: Array, left: float) -> None:
    """Take the rotors to their commanded speeds, but for a share of the way that is left."""
    if left > 0.0:
        for i in range(len(speeds)):
            state[13 + i] = speeds[i] + (state[13 + i] - speeds[i]) * left
    else:
        for i in range(len(speeds)):
            state[13 + i] = speeds[i]


@loop_part
def left_after(dt_s: float, lag_s: float) -> float:
    """Return the share of the way to a held command that a first-order lag leaves: exact."""
    return math.exp(-dt_s / lag_s) if lag_s > 0.0 else 0.0


@loop_part
def wrench_of(state: Array, frame: Airframe, ground: Array) -> tuple[float, float, float, float]:
    """Return the rotors' thrust and their torques about the body's axes."""
    thrust, roll, pitch, yaw = 0.0, 0.0, 0.0, 0.0
    rotors = frame.rotors
    for i in range(len(rotors)):
        speed = state[13 + i]
        lift = ground_effect_thrust_N(speed, frame.k_N_s2, ground[FACTOR, int(rotors[i, DISC])])
        thrust += lift
        roll += rotors[i, AT_Y] * lift
        pitch -= rotors[i, AT_X] * lift
        yaw -= rotors[i, SPIN] * drag_torque_Nm(speed, frame.c_Nm_s2)
    return thrust, roll, pitch, yaw


@loop_part
def any_of(row: int, ground: Array) -> bool:
    """Tell whether any disc has a mark in that row."""
    marked = 0.0
    for i in range(ground.shape[1]):
        marked += ground[row, i]
    return marked > 0.0


@loop_part
def wind_at(time_s: float, gusts: Array, axis: int) -> float:
    """Return the wind along an axis: gusts of 1 - cos shape, rows of time, length and velocity."""
    wind = 0.0
    for g in range(len(gusts)):
        since = time_s - gusts[g, 0]
        if 0.0 < since < gusts[g, 1]:
            wind += gusts[g, 2 + axis] * 0.5 * (1.0 - math.cos(2.0 * math.pi * since / gusts[g, 1]))
    return wind


@loop_part
def kick(
    time_s: float, state: Array, frame: Airframe, gusts: Array, ground: Array, dt: float
) -> None:
    """Change all velocities for one step.

    Drag against the air is taken at the mean of old and new velocity.
    """
    w, x, y, z = state[6], state[7], state[8], state[9]
    lift, roll, pitch, yaw = wrench_of(state, frame, ground)
    kick_angular(
        state, roll, pitch, yaw,
        frame.inertia_x_kgm2, frame.inertia_y_kgm2, frame.inertia_z_kgm2, dt,
    )  # fmt: skip
    ax = lift * 2.0 * (x * z + w * y) / frame.mass_kg
    ay = lift * 2.0 * (y * z - w * x) / frame.mass_kg
    az = lift * (1.0 - 2.0 * (x * x + y * y)) / frame.mass_kg - frame.gravity_m_s2
    if frame.drag_N_s_m > 0.0:
        half = 0.5 * dt * frame.drag_N_s_m / frame.mass_kg
        pushed = (ax, ay, az)
        for axis in range(3):
            wind = wind_at(time_s, gusts, axis)
            gained = dt * pushed[axis] + 2.0 * half * wind
            state[3 + axis] = ((1.0 - half) * state[3 + axis] + gained) / (1.0 + half)
    else:
        kick_linear(state, ax, ay, az, dt)


@loop_part
def write_row(
    row: Array,
    time_s: float,
    state: Array,
    goal: Array,
    frame: Airframe,
    ground: Array,
    memory: Array,
) -> None:
    """Write one row of the log."""
    w, x, y, z = state[6], state[7], state[8], state[9]
    row[0] = time_s
    for k in range(6):
        row[1 + k] = state[k]
    row[7], row[8], row[9] = roll_of(w, x, y, z), pitch_of(w, x, y, z), yaw_of(w, x, y, z)
    for k in range(3):
        row[10 + k] = state[10 + k]
        row[13 + k] = memory[COMMAND + k]
        row[16 + k] = memory[ESTIMATE + 3 + k]
        row[22 + k] = goal[1 + k]
    row[19] = memory[ESTIMATE + 2]
    n = ground.shape[1]
    extra_x, extra_y = 0.0, 0.0
    rotors = frame.rotors
    for i in range(len(rotors)):
        speed = state[13 + i]
        factor = ground[FACTOR, int(rotors[i, DISC])]
        more = ground_effect_thrust_N(speed, frame.k_N_s2, factor - 1.0)
        extra_x += rotors[i, AT_Y] * more
        extra_y -= rotors[i, AT_X] * more
        row[25 + 3 * n + i] = speed
    row[20], row[21] = extra_x, extra_y
    for i in range(n):
        row[25 + i] = ground[COVERAGE, i]
        row[25 + n + i] = ground[HEIGHT, i]
        row[25 + 2 * n + i] = ground[FACTOR, i]


@loop_part
def observe(
    period: int,
    period_s: float,
    ramp: float,
    state: Array,
    goals: Array,
    noise: Array,
    plan: Plan,
    seen: Array,
) -> None:
    """Take the goal that holds at a period's beginning, and write what the controller sees."""
    at = plan[AT_GOAL]
    now = period * period_s
    while at + 1 < len(goals) and goals[at + 1, 0] <= now:
        at += 1
    plan[AT_GOAL] = at
    row = min(period, len(noise) - 1)
    sense(now, state, noise[row], goals[at], goals[max(at - 1, 0)], ramp, seen)


@loop_part
def fly_period(
    period: int,
    period_s: float,
    state: Array,
    frame: Airframe,
    discs: Discs,
    below: Tables,
    goals: Array,
    gusts: Array,
    plan: Plan,
    log: Array,
    ground: Array,
    memory: Array,
    speeds: Array,
) -> bool:
    """Fly one control period at the speeds commanded; return whether that ended the flight."""
    ticks = plan[TICKS]
    dt = period_s / ticks
    now = period * period_s
    half, whole = left_after(0.5 * dt, frame.lag_s), left_after(dt, frame.lag_s)
    if period == 0:
        motors(state, speeds, 0.0)
    if period % plan[LOG_EVERY] == 0 and plan[ROWS] < len(log):
        look_down(now, state, discs, below, ground, False)
        write_row(log[plan[ROWS]], now, state, goals[plan[AT_GOAL]], frame, ground, memory)
        plan[ROWS] += 1
    drift(state, 0.5 * dt)
    motors(state, speeds, half)
    for tick in range(ticks):
        middle = now + (tick + 0.5) * dt
        look_down(middle, state, discs, below, ground, False)
        if any_of(TOUCHES, ground):
            plan[ENDING] = STRUCK
            return True
        if any_of(HELD, ground):
            plan[HELD_TICKS] += 1
        kick(middle, state, frame, gusts, ground, dt)
        between = tick + 1 < ticks
        drift(state, dt if between else 0.5 * dt)
        motors(state, speeds, whole if between else half)
    if not math.isfinite(state[0] + state[2] + state[6] + state[10] + state[11]):
        plan[ENDING] = LOST
        return True
    return False


@compiled
def fly_loop(
    state: Array,
    law: Law,
    frame: Airframe,
    known: Airframe,
    discs: Discs,
    below: Tables,
    chart: Tables,
    goals: Array,
    yaw_rad: float,
    gusts: Array,
    noise: Array,
    plan: Plan,
    log: Array,
    ground: Array,
    guess: Array,
    memory: Array,
    speeds: Array,
    seen: Array,
) -> None:
    """Fly some control periods; the plan holds which, and is told how it went.

    Args:
        state: body and rotor speeds (13 + n,); is written to.
        law: the controller.
        frame: the vehicle.
        known: the vehicle as the controller knows it.
        discs: its rotor discs.
        below: what is there.
        chart: the map of the feedforward.
        goals: rows of time of issue, x, y, z, speed; the first is where the flight begins.
        yaw_rad: heading to hold.
        gusts: rows of time, length, wind along x, y, z.
        noise: gyro noise (n_periods, 3), or one row that holds for all.
        plan: integers (`N_PLAN`,).
        log: (rows, columns) is written to.
        ground: scratch for what is there.
        guess: scratch for the map.
        memory: of the controller, zeros at first.
        speeds: scratch for the commands (n,).
        seen: scratch for what the controller sees.
    """
    for period in range(plan[FIRST], plan[LAST]):
        observe(period, law.period_s, law.ramp, state, goals, noise, plan, seen)
        goal = goals[plan[AT_GOAL]]
        now = period * law.period_s
        decide(now, state, seen, goal, yaw_rad, law, known, discs, chart, guess, memory)
        share_out(memory, guess, law.feedforward, known, speeds)
        if fly_period(
            period, law.period_s, state, frame, discs, below, goals, gusts, plan, log, ground,
            memory, speeds,
        ):  # fmt: skip
            return
