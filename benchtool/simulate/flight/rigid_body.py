"""A rigid body that moves freely: attitude as a quaternion, steps that keep what is conserved.

Axes: world x, y horizontal and z up; body x forward, y left, z up. The quaternion (w, x, y, z)
turns body vectors into world vectors. Euler angles are yaw, pitch, roll in that order; positive
pitch is nose down, positive roll lifts the left side (as the rows of `aero.mixer`).

A step is drift, kick, drift (Strang's splitting): places and attitude move for half a step at
constant velocities, velocities change for a whole step under the forces found there, and the second
half follows. Second order, time-reversible, one evaluation of the forces.
"""

from __future__ import annotations

import math

import numpy as np

from benchtool.core.array import Array
from benchtool.physics.expression import loop_part

X, Y, Z, VX, VY, VZ, QW, QX, QY, QZ, P, Q, R = range(13)
"""Places in the state: position m, velocity m/s, quaternion, body rates rad/s."""

N_STATES = 13
"""How many come before the rotors' speeds (rad/s) in the state."""

GRAVITY_M_S2 = 9.81
"""Standard gravity rounded as in the notes' prototype: m/s2."""


def at_rest(position_m: tuple[float, float, float], yaw_rad: float = 0.0) -> Array:
    """Return the state (13,) of a body that stands level at a place."""
    state = np.zeros(N_STATES)
    state[:3] = position_m
    state[QW], state[QZ] = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    return state


def from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Array:
    """Return the quaternion (4,) of yaw, then pitch, then roll."""
    cr, sr = math.cos(0.5 * roll_rad), math.sin(0.5 * roll_rad)
    cp, sp = math.cos(0.5 * pitch_rad), math.sin(0.5 * pitch_rad)
    cy, sy = math.cos(0.5 * yaw_rad), math.sin(0.5 * yaw_rad)
    return np.array(
        [
            cr * cp * cy + sr * sp * sy,
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
        ]
    )


def rotation_matrix(quaternion: Array) -> Array:
    """Return the matrix (3, 3) that turns body vectors into world vectors."""
    w, x, y, z = quaternion
    return np.array(
        [
            [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
            [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
            [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
        ]
    )


@loop_part
def roll_of(w: float, x: float, y: float, z: float) -> float:
    """Return the roll of a quaternion: rad."""
    return math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))


@loop_part
def pitch_of(w: float, x: float, y: float, z: float) -> float:
    """Return the pitch of a quaternion, nose down: rad."""
    return math.asin(min(max(2.0 * (w * y - z * x), -1.0), 1.0))


@loop_part
def yaw_of(w: float, x: float, y: float, z: float) -> float:
    """Return the yaw of a quaternion: rad."""
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@loop_part
def drift(state: Array, dt_s: float) -> None:
    """Move place and attitude at constant velocities; exact for a constant body rate."""
    for axis in range(3):
        state[axis] += state[3 + axis] * dt_s
    p, q, r = state[10], state[11], state[12]
    rate = math.sqrt(p * p + q * q + r * r)
    half = 0.5 * rate * dt_s
    if half > 1e-8:
        along = math.sin(half) / rate
    else:
        along = 0.5 * dt_s
    cosine = math.cos(half)
    a, b, c = p * along, q * along, r * along
    w, x, y, z = state[6], state[7], state[8], state[9]
    state[6] = w * cosine - x * a - y * b - z * c
    state[7] = w * a + x * cosine + y * c - z * b
    state[8] = w * b - x * c + y * cosine + z * a
    state[9] = w * c + x * b - y * a + z * cosine


@loop_part
def kick_linear(state: Array, ax_m_s2: float, ay_m_s2: float, az_m_s2: float, dt_s: float) -> None:
    """Change the velocity under an acceleration in world axes, gravity included."""
    state[3] += dt_s * ax_m_s2
    state[4] += dt_s * ay_m_s2
    state[5] += dt_s * az_m_s2


@loop_part
def kick_angular(
    state: Array,
    roll_Nm: float,
    pitch_Nm: float,
    yaw_Nm: float,
    jx: float,
    jy: float,
    jz: float,
    dt_s: float,
) -> None:
    """Change the body rates under a torque in body axes, with the gyroscopic coupling.

    J dw/dt = tau - w x J w by the implicit midpoint rule, four fixed-point iterations: it keeps
    the energy and the magnitude of the momentum of a free body to the order of the iterations.
    jx, jy and jz are the principal moments of inertia (kg m2).
    """
    p0, q0, r0 = state[10], state[11], state[12]
    dp, dq, dr = dt_s * roll_Nm / jx, dt_s * pitch_Nm / jy, dt_s * yaw_Nm / jz
    cx, cy, cz = dt_s * (jy - jz) / jx, dt_s * (jz - jx) / jy, dt_s * (jx - jy) / jz
    p, q, r = p0 + dp, q0 + dq, r0 + dr
    for _ in range(4):
        pm, qm, rm = 0.5 * (p0 + p), 0.5 * (q0 + q), 0.5 * (r0 + r)
        p, q, r = p0 + dp + cx * qm * rm, q0 + dq + cy * rm * pm, r0 + dr + cz * pm * qm
    state[10], state[11], state[12] = p, q, r
