"""The flight controller in the loop: position, velocity, attitude, rate; observer; feedforward.

One control period: the laws of `benchtool.control` on both horizontal axes, height and three
attitude angles, shared out over the rotors by the mixer's pseudo-inverse. Lateral axes are the same
laws on roll. The observer watches all six components and compensates the torques, as the paper's
controller does; the feedforward divides each rotor's thrust by the factor that a map gives.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.aero.expression import Quantity, loop_part
from benchtool.aero.rotor import speed_from_thrust
from benchtool.control.cascade import (
    PositionLoop,
    acceleration_command,
    climb_command,
    lifting_thrust,
    next_velocity_integral,
    pitch_command,
    velocity_command,
)
from benchtool.control.feedforward import compensated_thrust, expected_factor
from benchtool.control.limits import integrated
from benchtool.control.observer import next_explained, observed
from benchtool.control.pid import AttitudePid, PidState, attitude_torque, next_pid_state
from benchtool.simulate.environment import Tables
from benchtool.simulate.flight_ground import FACTOR, Discs, look_down
from benchtool.simulate.rigid_body import pitch_of, roll_of, yaw_of

Array = NDArray[np.float64]

N_MEMORY = 26
"""Velocity command (2), velocity integral (2), climb integral, observer's z (6), attitude integrals
(6), estimate (6), attitude command (3)."""

VREF, VINT, CLIMB, EXPLAINED, INTEGRALS, ESTIMATE, COMMAND = 0, 2, 4, 5, 11, 17, 23

FREE_M_S = 3.0
"""Speed limit while a ramp leads the way, so that the ramp alone sets the pace; assumed."""


class Law(NamedTuple):
    """Hold the numbers of a flight controller.

    Attributes:
        position: the horizontal loops.
        roll, pitch, yaw: the attitude loops.
        k_z_per_s2, k_vz_per_s, k_iz_per_s3, climb_limit_m_s2: the height loop.
        observer_per_s: bandwidth of the observer.
        compensate: 1 to subtract the observed torque, 0 only to watch.
        feedforward: strength, 0 without.
        whole: the map knows only whether a rotor's centre is over something.
        from_s: when observer and feedforward are switched on.
        ramp: 1 leads the reference along at the given speed in place of limiting the speed.
        period_s: control period.
    """

    position: PositionLoop
    roll: AttitudePid
    pitch: AttitudePid
    yaw: AttitudePid
    k_z_per_s2: float
    k_vz_per_s: float
    k_iz_per_s3: float
    climb_limit_m_s2: float
    observer_per_s: float
    compensate: float
    feedforward: float
    whole: bool
    from_s: float
    ramp: float
    period_s: float


class Airframe(NamedTuple):
    """Hold what the motion needs of a vehicle.

    Attributes:
        rotors: (n, 8) place x and y (m), spin, disc, and the thrust over thrust (N/N) and over the
            three torques (N/(N m)) that the mixer shares out to it.
        mass_kg: mass.
        inertia_x_kgm2, inertia_y_kgm2, inertia_z_kgm2: principal moments.
        k_N_s2, c_Nm_s2: of eq. (8).
        top_speed_rad_s: what a motor can reach.
        lag_s: first-order time constant of the motors' speed; 0 without.
        drag_N_s_m: force per velocity against the air; 0 without.
        gravity_m_s2: gravity.
    """

    rotors: Array
    mass_kg: float
    inertia_x_kgm2: float
    inertia_y_kgm2: float
    inertia_z_kgm2: float
    k_N_s2: float
    c_Nm_s2: float
    top_speed_rad_s: float
    lag_s: float
    drag_N_s_m: float
    gravity_m_s2: float


AT_X, AT_Y, SPIN, DISC, PER_THRUST, PER_ROLL, PER_PITCH, PER_YAW = range(8)
"""Columns of `Airframe.rotors`."""


@loop_part
def lead(time_s: float, state: Array, goal: Array, began: Array, law: Law) -> tuple[float, float]:
    """Return the place to steer to: the goal, or a point that runs ahead to it."""
    if law.ramp == 0.0:
        return goal[1], goal[2]
    dx, dy = goal[1] - began[1], goal[2] - began[2]
    length = math.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return goal[1], goal[2]
    share = min(goal[4] * (time_s - goal[0]) / length, 1.0)
    return began[1] + share * dx, began[2] + share * dy


@loop_part
def wanted_acceleration(
    error_m: float, limit_m_s: float, velocity_m_s: float, memory: Array, axis: int, law: Law
) -> Quantity:
    """Return the acceleration that one horizontal axis asks for, and keep its memory."""
    present = velocity_command(error_m, memory[VREF + axis], limit_m_s, law.position, law.period_s)
    memory[VREF + axis] = present
    error = present - velocity_m_s
    memory[VINT + axis] = next_velocity_integral(
        error, memory[VINT + axis], law.position, law.period_s
    )
    return acceleration_command(error, memory[VINT + axis], law.position)


@loop_part
def attitude(
    axis: int, wanted: float, angle: float, rate: float, memory: Array, pid: AttitudePid, dt: float
) -> Quantity:
    """Return the torque of one attitude loop, and keep its memory and its command."""
    at = INTEGRALS + 2 * axis
    before = PidState(memory[at], memory[at + 1])
    after = next_pid_state(wanted, angle, rate, before, pid, dt)
    memory[at], memory[at + 1] = after.rate_rad_s, after.acceleration_rad_s2
    memory[COMMAND + axis] = wanted
    return attitude_torque(wanted, angle, rate, after, pid)


@loop_part
def watch(
    component: int, momentum: float, known: float, on: float, memory: Array, law: Law
) -> None:
    """Take one component of the observer one period on."""
    memory[EXPLAINED + component] = next_explained(
        momentum,
        memory[EXPLAINED + component],
        known,
        memory[ESTIMATE + component],
        on,
        law.period_s,
    )


@loop_part
def steer(
    time_s: float,
    state: Array,
    gyro: Array,
    goal: Array,
    began: Array,
    yaw_rad: float,
    law: Law,
    frame: Airframe,
    discs: Discs,
    chart: Tables,
    ground: Array,
    memory: Array,
    speeds: Array,
) -> None:
    """Write the speeds to command (n,) for the control period that begins now.

    Args:
        time_s: since the flight began.
        state: of the body, as measured without error.
        gyro: body rates as the gyro shows them (3,).
        goal: time of issue, x, y, z, speed.
        began: the goal before, or the start.
        yaw_rad: heading to hold.
        law: the controller.
        frame: the vehicle as the controller knows it.
        discs: its rotor discs.
        chart: the map of the feedforward.
        ground: scratch for the map.
        memory: (`N_MEMORY`,) kept from period to period.
        speeds: is written to.
    """
    w, x, y, z = state[6], state[7], state[8], state[9]
    roll, pitch, yaw = roll_of(w, x, y, z), pitch_of(w, x, y, z), yaw_of(w, x, y, z)
    to_x, to_y = lead(time_s, state, goal, began, law)
    ex, ey = to_x - state[0], to_y - state[1]
    away_m = math.sqrt(ex * ex + ey * ey)
    limit = goal[4] if law.ramp == 0.0 else FREE_M_S
    limit_x, limit_y = limit, limit
    if away_m > 0.0:
        limit_x, limit_y = limit * abs(ex) / away_m, limit * abs(ey) / away_m
    ax = wanted_acceleration(ex, limit_x, state[3], memory, 0, law)
    ay = wanted_acceleration(ey, limit_y, state[4], memory, 1, law)
    cosine, sine = math.cos(yaw), math.sin(yaw)
    forward, left = cosine * ax + sine * ay, cosine * ay - sine * ax
    pitch_wanted = pitch_command(forward, frame.gravity_m_s2, law.position)
    roll_wanted = -pitch_command(left, frame.gravity_m_s2, law.position)
    turn = yaw_rad - yaw
    turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
    dt = law.period_s
    wrench = (
        0.0,
        attitude(0, roll_wanted, roll, gyro[0], memory, law.roll, dt),
        attitude(1, pitch_wanted, pitch, gyro[1], memory, law.pitch, dt),
        attitude(2, yaw + turn, yaw, gyro[2], memory, law.yaw, dt),
    )
    ez = goal[3] - state[2]
    memory[CLIMB] = integrated(memory[CLIMB], law.k_iz_per_s3 * ez, np.inf, dt)
    climb = climb_command(
        ez, state[5], memory[CLIMB], law.k_z_per_s2, law.k_vz_per_s, law.climb_limit_m_s2
    )
    up = math.cos(pitch) * math.cos(roll)
    thrust = lifting_thrust(climb, frame.mass_kg, frame.gravity_m_s2, up)

    on = 1.0 if law.observer_per_s > 0.0 and time_s >= law.from_s else 0.0
    jx, jy, jz = law.roll.inertia_kgm2, law.pitch.inertia_kgm2, law.yaw.inertia_kgm2
    p, q, r = gyro[0], gyro[1], gyro[2]
    momentum = (
        frame.mass_kg * state[3], frame.mass_kg * state[4], frame.mass_kg * state[5],
        jx * p, jy * q, jz * r,
    )  # fmt: skip
    for c in range(6):
        seen = observed(momentum[c], memory[EXPLAINED + c], law.observer_per_s)
        memory[ESTIMATE + c] = on * seen
    undone = on * law.compensate
    tx = wrench[1] - undone * memory[ESTIMATE + 3]
    ty = wrench[2] - undone * memory[ESTIMATE + 4]
    tz = wrench[3] - undone * memory[ESTIMATE + 5]
    known = (
        thrust * 2.0 * (x * z + w * y),
        thrust * 2.0 * (y * z - w * x),
        thrust * (1.0 - 2.0 * (x * x + y * y)) - frame.mass_kg * frame.gravity_m_s2,
        tx + (jy - jz) * q * r,
        ty + (jz - jx) * r * p,
        tz + (jx - jy) * p * q,
    )
    for c in range(6):
        watch(c, momentum[c], known[c], on, memory, law)

    forward_on = law.feedforward > 0.0 and time_s >= law.from_s
    if forward_on:
        look_down(time_s, state, discs, chart, ground, law.whole)
    for i in range(len(speeds)):
        rotors = frame.rotors
        wanted = rotors[i, PER_THRUST] * thrust + rotors[i, PER_ROLL] * tx
        wanted += rotors[i, PER_PITCH] * ty + rotors[i, PER_YAW] * tz
        factor = 1.0
        if forward_on:
            factor = expected_factor(ground[FACTOR, int(rotors[i, DISC])], law.feedforward)
        asked = speed_from_thrust(compensated_thrust(wanted, factor), frame.k_N_s2)
        speeds[i] = min(asked, frame.top_speed_rad_s)
