"""From squared rotor speeds to thrust and torques, and back (eq. 9).

Axes: x forward, y left, z up. Positive roll torque lifts the left side, positive pitch torque
pushes the nose down (eq. 9 with rotor 1 in front), positive yaw torque turns counter-clockwise
seen from above. A rotor's spin is +1 counter-clockwise seen from above; its drag turns the body
the other way.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.physics.expression import Quantity, expression

Array = NDArray[np.float64]

WRENCH = ("thrust_N", "roll_Nm", "pitch_Nm", "yaw_Nm")
"""The mixer's rows in order: T, tau_phi, tau_theta, tau_psi of eq. (9)."""


class RotorLayout(NamedTuple):
    """Say where rotors are and which way they turn.

    Attributes:
        names: one for each rotor, in the order of eq. (9).
        x_m: forward (n,): m.
        y_m: left (n,): m.
        spin: +1 counter-clockwise seen from above, -1 clockwise (n,).
    """

    names: tuple[str, ...]
    x_m: Array
    y_m: Array
    spin: Array


def plus_layout(arm_m: float) -> RotorLayout:
    """Return eq. (9)'s layout: rotors 1 to 4 are front, left, rear, right on arms of that length.

    The paper calls the arm d in eq. (9), and the distance between adjacent axes d in eq. (3):
    the latter is arm times sqrt(2).
    """
    return RotorLayout(
        ("front", "left", "rear", "right"),
        np.array([arm_m, 0.0, -arm_m, 0.0]),
        np.array([0.0, arm_m, 0.0, -arm_m]),
        np.array([1.0, -1.0, 1.0, -1.0]),
    )


def cross_layout(arm_m: float) -> RotorLayout:
    """Return the plus layout turned by 45 degrees to the left."""
    half = arm_m * np.sqrt(0.5)
    return RotorLayout(
        ("front_left", "rear_left", "rear_right", "front_right"),
        np.array([half, -half, -half, half]),
        np.array([half, half, -half, -half]),
        np.array([1.0, -1.0, 1.0, -1.0]),
    )


LAYOUTS = {"plus": plus_layout, "cross": cross_layout}


def rotor_layout(name: str, arm_m: float) -> RotorLayout:
    """Return the layout of that name; an unknown name lists the known ones."""
    if name not in LAYOUTS:
        raise UnknownChoice("rotor layout", name, LAYOUTS)
    return LAYOUTS[name](arm_m)


def mixer_matrix(
    x_m: Sequence[float] | Array,
    y_m: Sequence[float] | Array,
    spin: Sequence[float] | Array,
    k_N_s2: float,
    c_Nm_s2: float,
) -> Array:
    """Return the matrix (4, n) from squared speeds to `WRENCH` for rotors at (x, y) (eq. 9).

    Rows: k; k y; -k x; -c spin. `k_N_s2` and `c_Nm_s2` are those of eq. (8).
    """
    x, y, turn = (np.asarray(value, float) for value in (x_m, y_m, spin))
    if not x.shape == y.shape == turn.shape or x.ndim != 1:
        raise InputError(
            f"a mixer needs x, y and spin of every rotor, got {x.size}, {y.size} and {turn.size} "
            f"values; give one of each per rotor"
        )
    return np.array([np.full(x.size, k_N_s2), k_N_s2 * y, -k_N_s2 * x, -c_Nm_s2 * turn])


def allocate(matrix: Array, wrench: Array) -> Array:
    """Return squared speeds (n, ...) for a wanted wrench (4, ...), by the pseudo-inverse.

    Exact for four rotors that reach every row; the least sum of squares where there are more; the
    nearest wrench where the rotors cannot make it. Entries may be negative: such a wrench is
    out of reach, and limiting is the caller's.
    """
    squares: Array = np.linalg.pinv(matrix) @ wrench
    return squares


@expression
def roll_moment_Nm(thrust_N: Quantity, y_m: Quantity) -> Quantity:
    """Return sum y_i T_i over rotors (n, ...), positive left side up: N m."""
    total = 0.0 * thrust_N[0]
    for i in range(len(y_m)):
        total = total + y_m[i] * thrust_N[i]
    return total


@expression
def pitch_moment_Nm(thrust_N: Quantity, x_m: Quantity) -> Quantity:
    """Return -sum x_i T_i over rotors (n, ...), positive nose down: N m.

    A wall of ground effect under the front rotors gives a negative one (backward).
    """
    total = 0.0 * thrust_N[0]
    for i in range(len(x_m)):
        total = total - x_m[i] * thrust_N[i]
    return total
