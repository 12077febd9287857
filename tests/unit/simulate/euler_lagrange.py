"""The same rigid body in the paper's form: M(q) qdd + C(q, qd) qd + G = F (eq. 5 to 7 and 11).

q holds position and Euler angles (roll, pitch, yaw). The angles' part is J(eta) = W^T I W, with W
from angle rates to body rates; the paper's "J in the inertial frame" can only mean this one. Its
generalized force is (R F, W^T tau): forces and torques of the body, the ground effect's among them,
are turned, which eq. (7) and (11) leave to the reader. Where cos(pitch) vanishes the form has no
inverse; a flight uses `rigid_body`, and this module is its check.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from benchtool.core.units import Array
from benchtool.simulate.controllers.controller import GRAVITY_M_S2


def from_euler(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Array:
    """Return the quaternion (4,), real part first, of yaw, then pitch, then roll."""
    turned = Rotation.from_euler("ZYX", (yaw_rad, pitch_rad, roll_rad))
    return np.asarray(turned.as_quat(scalar_first=True))


def rotation_matrix(quaternion: Array) -> Array:
    """Return the matrix (3, 3) that turns body vectors into world vectors."""
    return np.asarray(Rotation.from_quat(quaternion, scalar_first=True).as_matrix())


def rate_matrix(roll_rad: float, pitch_rad: float) -> Array:
    """Return W (3, 3): body rates from the rates of roll, pitch and yaw."""
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    return np.array([[1.0, 0.0, -sp], [0.0, cr, sr * cp], [0.0, -sr, cr * cp]])


def rate_matrix_derivatives(roll_rad: float, pitch_rad: float) -> tuple[Array, Array, Array]:
    """Return dW over roll, pitch and yaw, (3, 3) each."""
    cr, sr = math.cos(roll_rad), math.sin(roll_rad)
    cp, sp = math.cos(pitch_rad), math.sin(pitch_rad)
    by_roll = np.array([[0.0, 0.0, 0.0], [0.0, -sr, cr * cp], [0.0, -cr, -sr * cp]])
    by_pitch = np.array([[0.0, 0.0, -cp], [0.0, 0.0, -sr * sp], [0.0, 0.0, -cr * sp]])
    return by_roll, by_pitch, np.zeros((3, 3))


def mass_matrix(mass_kg: float, inertia_kgm2: Array, angles_rad: Array) -> Array:
    """Return M (6, 6): the mass, and W^T I W, for principal moments of inertia (3,)."""
    W = rate_matrix(angles_rad[0], angles_rad[1])
    M = np.zeros((6, 6))
    M[:3, :3] = mass_kg * np.eye(3)
    M[3:, 3:] = W.T @ np.diag(inertia_kgm2) @ W
    return M


def coriolis_matrix(inertia_kgm2: Array, angles_rad: Array, angle_rates_rad_s: Array) -> Array:
    """Return C (6, 6) by Christoffel's symbols of W^T I W: M' - 2C is skew-symmetric."""
    W = rate_matrix(angles_rad[0], angles_rad[1])
    inertia = np.diag(inertia_kgm2)
    slopes = [
        dW.T @ inertia @ W + W.T @ inertia @ dW
        for dW in rate_matrix_derivatives(angles_rad[0], angles_rad[1])
    ]
    C = np.zeros((6, 6))
    for i in range(3):
        for j in range(3):
            C[3 + i, 3 + j] = 0.5 * sum(
                (slopes[k][i, j] + slopes[j][i, k] - slopes[i][j, k]) * angle_rates_rad_s[k]
                for k in range(3)
            )
    return C


def acceleration(
    mass_kg: float, inertia_kgm2: Array, q: Array, q_dot: Array, force_N: Array, torque_Nm: Array
) -> Array:
    """Return the second derivative of q (6,) for a force and a torque in body axes (eq. 11).

    Positions and angles q (6,), their rate, and principal moments of inertia (3,).
    """
    angles, rates = q[3:], q_dot[3:]
    turned = rotation_matrix(from_euler(*angles)) @ force_N
    right = np.concatenate([turned, rate_matrix(angles[0], angles[1]).T @ torque_Nm])
    right[2] -= mass_kg * GRAVITY_M_S2
    right[3:] -= (coriolis_matrix(inertia_kgm2, angles, rates) @ q_dot)[3:]
    solved: Array = np.asarray(np.linalg.solve(mass_matrix(mass_kg, inertia_kgm2, angles), right))
    return solved
