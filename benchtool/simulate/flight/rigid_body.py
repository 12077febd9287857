"""Free rigid body: attitude as a quaternion, structure-preserving time steps.

Axes: world x, y horizontal and z up; body x forward, y left, z up. The quaternion turns body
vectors into world vectors. Euler angles are yaw, pitch, roll in that order; positive pitch is nose
down, positive roll lifts the left side (as the rows of `physics.mixer`).

A step is drift, kick, drift (Strang's splitting): position and attitude change for half a step at
constant velocities, velocities for a whole step under the forces there, then the second half
follows. Second order, time-reversible, one evaluation of the forces.
"""

from __future__ import annotations

import math
from collections import namedtuple
from typing import Any

from benchtool.physics.expression import expression, inlined_expression

GRAVITY_M_S2 = 9.81  # standard gravity rounded as in the notes' prototype: m/s2
SMALL_TURN = 1e-4  # rad2; below it the series in `drift` are exact to rounding (2e-16)

# State of a body: position and velocity in the world, attitude, body rates, and the random torque
# about the pitch axis.
FreeBody = namedtuple(
    "FreeBody",
    "x_m y_m z_m vx_m_s vy_m_s vz_m_s qw qx qy qz p_rad_s q_rad_s r_rad_s wake_Nm",
    defaults=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
)


def at_rest(position_m: tuple[float, float, float], yaw_rad: float = 0.0) -> FreeBody:
    """Return a level body at rest."""
    return FreeBody(*position_m, qw=math.cos(0.5 * yaw_rad), qz=math.sin(0.5 * yaw_rad))


@inlined_expression
def roll_angle(body: Any) -> Any:
    """Return the roll: rad."""
    w, x, y, z = body.qw, body.qx, body.qy, body.qz
    return math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))


@inlined_expression
def pitch_angle(body: Any) -> Any:
    """Return the pitch, nose down: rad."""
    return math.asin(min(max(2.0 * (body.qw * body.qy - body.qz * body.qx), -1.0), 1.0))


@inlined_expression
def yaw_angle(body: Any) -> Any:
    """Return the yaw: rad."""
    w, x, y, z = body.qw, body.qx, body.qy, body.qz
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


@expression
def upward(body: Any) -> Any:
    """Return the z axis of the body in world axes (3,): the thrust direction."""
    w, x, y, z = body.qw, body.qx, body.qy, body.qz
    return 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)


@expression
def forward(body: Any) -> Any:
    """Return the x axis of the body in world axes (3,)."""
    w, x, y, z = body.qw, body.qx, body.qy, body.qz
    return 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)


@expression
def leftward(body: Any) -> Any:
    """Return the y axis of the body in world axes (3,)."""
    w, x, y, z = body.qw, body.qx, body.qy, body.qz
    return 2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)


@inlined_expression
def drift(body: Any, dt_s: Any) -> Any:
    """Return the body moved at constant velocities; exact for a constant body rate."""
    p, q, r = body.p_rad_s, body.q_rad_s, body.r_rad_s
    squared = 0.25 * dt_s * dt_s * (p * p + q * q + r * r)
    if squared < SMALL_TURN:
        along = 0.5 * dt_s * (1.0 - squared / 6.0 * (1.0 - squared / 20.0))
        cosine = 1.0 - 0.5 * squared * (1.0 - squared / 12.0 * (1.0 - squared / 30.0))
    else:
        half = math.sqrt(squared)
        along, cosine = 0.5 * dt_s * math.sin(half) / half, math.cos(half)
    a, b, c = p * along, q * along, r * along
    w, x, y, z = body.qw, body.qx, body.qy, body.qz
    return FreeBody(
        body.x_m + body.vx_m_s * dt_s,
        body.y_m + body.vy_m_s * dt_s,
        body.z_m + body.vz_m_s * dt_s,
        body.vx_m_s,
        body.vy_m_s,
        body.vz_m_s,
        w * cosine - x * a - y * b - z * c,
        w * a + x * cosine + y * c - z * b,
        w * b - x * c + y * cosine + z * a,
        w * c + x * b - y * a + z * cosine,
        p,
        q,
        r,
        body.wake_Nm,
    )


@inlined_expression
def rates_after_impulse(body: Any, torque_Nm: Any, inertia_kgm2: Any, dt_s: Any) -> Any:
    """Return the body rates (3,) after a torque in body axes (3,), with the gyroscopic coupling.

    J dw/dt = tau - w x J w by the implicit midpoint rule, four fixed-point iterations: it conserves
    energy and angular momentum of a free body to the order of the iterations.
    `inertia_kgm2` (3,) are the principal moments.
    """
    roll_Nm, pitch_Nm, yaw_Nm = torque_Nm
    jx, jy, jz = inertia_kgm2
    p0, q0, r0 = body.p_rad_s, body.q_rad_s, body.r_rad_s
    dp, dq, dr = dt_s * roll_Nm / jx, dt_s * pitch_Nm / jy, dt_s * yaw_Nm / jz
    cx, cy, cz = dt_s * (jy - jz) / jx, dt_s * (jz - jx) / jy, dt_s * (jx - jy) / jz
    p, q, r = p0 + dp, q0 + dq, r0 + dr
    for _ in range(4):
        pm, qm, rm = 0.5 * (p0 + p), 0.5 * (q0 + q), 0.5 * (r0 + r)
        p, q, r = p0 + dp + cx * qm * rm, q0 + dq + cy * rm * pm, r0 + dr + cz * pm * qm
    return p, q, r


@inlined_expression
def apply_impulse(body: Any, velocity_m_s: Any, rates_rad_s: Any, wake_Nm: Any) -> Any:
    """Return the body with new velocities (3,), body rates (3,) and wake torque."""
    vx, vy, vz = velocity_m_s
    p, q, r = rates_rad_s
    return FreeBody(
        body.x_m, body.y_m, body.z_m, vx, vy, vz,
        body.qw, body.qx, body.qy, body.qz, p, q, r, wake_Nm,
    )  # fmt: skip
