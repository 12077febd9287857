"""The flight controller in the loop: position, velocity, attitude, rate; observer; feedforward.

One control period: what is measured (`sense`), the laws of `controllers` on both horizontal axes,
height and three attitude angles (`decide`), shared out over the rotors by the mixer's
pseudo-inverse (`share_out`). A controller of the user's own stands in the place of `decide`.
Lateral axes are the same laws on roll. The observer watches all six components and compensates the
torques, as the paper's controller does; the feedforward divides each rotor's thrust by the factor
that a map gives.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from benchtool.core.array import Array
from benchtool.physics.expression import Quantity, loop_part
from benchtool.physics.rotor import speed_from_thrust
from benchtool.simulate.controllers.cascade import (
    PositionLoop,
    acceleration_command,
    climb_command,
    lifting_thrust,
    next_velocity_integral,
    pitch_command,
    velocity_command,
)
from benchtool.simulate.controllers.feedforward import compensated_thrust, expected_factor
from benchtool.simulate.controllers.limits import integrated
from benchtool.simulate.controllers.observer import next_explained, observed
from benchtool.simulate.controllers.pid import (
    AttitudePid,
    PidState,
    attitude_torque,
    next_pid_state,
)
from benchtool.simulate.environment import Tables
from benchtool.simulate.flight.ground import FACTOR, Discs, look_down
from benchtool.simulate.flight.rigid_body import pitch_of, roll_of, yaw_of

N_MEMORY = 30
"""Velocity command (2), velocity integral (2), climb integral, observer's z (6), attitude integrals
(6), estimate (6), attitude command (3), thrust and three torques to be shared out (4)."""

VREF, VINT, CLIMB, EXPLAINED, INTEGRALS, ESTIMATE, COMMAND, WRENCH = 0, 2, 4, 5, 11, 17, 23, 26

N_SEEN = 15
"""Place (3), velocity (3), roll, pitch, yaw, body rates of the gyro (3), place to steer to (3)."""

PLACE, VELOCITY, ANGLES, GYRO, TARGET = 0, 3, 6, 9, 12

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
def lead(time_s: float, goal: Array, began: Array, ramp: float) -> tuple[float, float]:
    """Return the place to steer to: the goal, or a point that runs ahead to it."""
    if ramp == 0.0:
        return goal[1], goal[2]
    dx, dy = goal[1] - began[1], goal[2] - began[2]
    length = math.sqrt(dx * dx + dy * dy)
    if length == 0.0:
        return goal[1], goal[2]
    share = min(goal[4] * (time_s - goal[0]) / length, 1.0)
    return began[1] + share * dx, began[2] + share * dy


@loop_part
def sense(
    time_s: float, state: Array, noise: Array, goal: Array, began: Array, ramp: float, seen: Array
) -> None:
    """Write what a controller sees (`N_SEEN`,): the state without error, but the gyro's noise."""
    for k in range(6):
        seen[PLACE + k] = state[k]
    w, x, y, z = state[6], state[7], state[8], state[9]
    seen[ANGLES] = roll_of(w, x, y, z)
    seen[ANGLES + 1] = pitch_of(w, x, y, z)
    seen[ANGLES + 2] = yaw_of(w, x, y, z)
    for k in range(3):
        seen[GYRO + k] = state[10 + k] + noise[k]
    seen[TARGET], seen[TARGET + 1] = lead(time_s, goal, began, ramp)
    seen[TARGET + 2] = goal[3]


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
def decide(
    time_s: float,
    state: Array,
    seen: Array,
    goal: Array,
    yaw_rad: float,
    law: Law,
    frame: Airframe,
    discs: Discs,
    chart: Tables,
    ground: Array,
    memory: Array,
) -> None:
    """Write the thrust and torques to ask for, and the factors to divide by, for this period.

    Args:
        time_s: since the flight began.
        state: of the body; its attitude turns the commanded thrust into world axes.
        seen: from `sense`.
        goal: time of issue, x, y, z, speed.
        yaw_rad: heading to hold.
        law: the controller.
        frame: the vehicle as the controller knows it.
        discs: its rotor discs.
        chart: the map of the feedforward.
        ground: scratch for the map; its factors are what the feedforward divides by.
        memory: (`N_MEMORY`,) kept from period to period; its wrench is written.
    """
    roll, pitch, yaw = seen[ANGLES], seen[ANGLES + 1], seen[ANGLES + 2]
    ex, ey = seen[TARGET] - seen[PLACE], seen[TARGET + 1] - seen[PLACE + 1]
    away_m = math.sqrt(ex * ex + ey * ey)
    limit = goal[4] if law.ramp == 0.0 else FREE_M_S
    limit_x, limit_y = limit, limit
    if away_m > 0.0:
        limit_x, limit_y = limit * abs(ex) / away_m, limit * abs(ey) / away_m
    ax = wanted_acceleration(ex, limit_x, seen[VELOCITY], memory, 0, law)
    ay = wanted_acceleration(ey, limit_y, seen[VELOCITY + 1], memory, 1, law)
    cosine, sine = math.cos(yaw), math.sin(yaw)
    forward, left = cosine * ax + sine * ay, cosine * ay - sine * ax
    pitch_wanted = pitch_command(forward, frame.gravity_m_s2, law.position)
    roll_wanted = -pitch_command(left, frame.gravity_m_s2, law.position)
    turn = yaw_rad - yaw
    turn -= 2.0 * math.pi * math.floor(turn / (2.0 * math.pi) + 0.5)
    dt = law.period_s
    p, q, r = seen[GYRO], seen[GYRO + 1], seen[GYRO + 2]
    asked_x = attitude(0, roll_wanted, roll, p, memory, law.roll, dt)
    asked_y = attitude(1, pitch_wanted, pitch, q, memory, law.pitch, dt)
    asked_z = attitude(2, yaw + turn, yaw, r, memory, law.yaw, dt)
    ez = seen[TARGET + 2] - seen[PLACE + 2]
    memory[CLIMB] = integrated(memory[CLIMB], law.k_iz_per_s3 * ez, np.inf, dt)
    climb = climb_command(
        ez,
        seen[VELOCITY + 2],
        memory[CLIMB],
        law.k_z_per_s2,
        law.k_vz_per_s,
        law.climb_limit_m_s2,
    )
    up = math.cos(pitch) * math.cos(roll)
    thrust = lifting_thrust(climb, frame.mass_kg, frame.gravity_m_s2, up)

    on = 1.0 if law.observer_per_s > 0.0 and time_s >= law.from_s else 0.0
    jx, jy, jz = law.roll.inertia_kgm2, law.pitch.inertia_kgm2, law.yaw.inertia_kgm2
    momentum = (
        frame.mass_kg * seen[VELOCITY],
        frame.mass_kg * seen[VELOCITY + 1],
        frame.mass_kg * seen[VELOCITY + 2],
        jx * p,
        jy * q,
        jz * r,
    )
    for c in range(6):
        estimate = observed(momentum[c], memory[EXPLAINED + c], law.observer_per_s)
        memory[ESTIMATE + c] = on * estimate
    undone = on * law.compensate
    tx = asked_x - undone * memory[ESTIMATE + 3]
    ty = asked_y - undone * memory[ESTIMATE + 4]
    tz = asked_z - undone * memory[ESTIMATE + 5]
    w, x, y, z = state[6], state[7], state[8], state[9]
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
    memory[WRENCH], memory[WRENCH + 1] = thrust, tx
    memory[WRENCH + 2], memory[WRENCH + 3] = ty, tz

    if law.feedforward > 0.0 and time_s >= law.from_s:
        look_down(time_s, state, discs, chart, ground, law.whole)
    else:
        for i in range(ground.shape[1]):
            ground[FACTOR, i] = 1.0


@loop_part
def share_out(
    memory: Array, ground: Array, strength: float, frame: Airframe, speeds: Array
) -> None:
    """Write the speeds to command (n,) from the wrench in the memory and the factors found."""
    rotors = frame.rotors
    thrust, tx = memory[WRENCH], memory[WRENCH + 1]
    ty, tz = memory[WRENCH + 2], memory[WRENCH + 3]
    for i in range(len(speeds)):
        wanted = rotors[i, PER_THRUST] * thrust + rotors[i, PER_ROLL] * tx
        wanted += rotors[i, PER_PITCH] * ty + rotors[i, PER_YAW] * tz
        factor = expected_factor(ground[FACTOR, int(rotors[i, DISC])], strength)
        asked = speed_from_thrust(compensated_thrust(wanted, factor), frame.k_N_s2)
        speeds[i] = min(asked, frame.top_speed_rad_s)
