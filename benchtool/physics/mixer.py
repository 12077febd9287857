"""Thrust and torques from squared rotor speeds (eq. 9).

Axes: x forward, y left, z up. Positive roll torque lifts the left side, positive pitch torque is
nose down (eq. 9 with rotor 1 in front), positive yaw torque is counter-clockwise seen from above. A
rotor's spin is +1 counter-clockwise seen from above; its drag torque on the body is opposite.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.units import Array
from benchtool.physics.expression import Quantity, expression

WRENCH = ("thrust_N", "roll_Nm", "pitch_Nm", "yaw_Nm")  # rows: T, tau_phi, tau_theta, tau_psi


def mixer_matrix(
    x_m: Sequence[float] | Array,
    y_m: Sequence[float] | Array,
    spin: Sequence[float] | Array,
    k_N_s2: float,
    c_Nm_s2: float,
) -> Array:
    """Return the matrix (4, n) from squared speeds to `WRENCH` for rotors at (x, y) (eq. 9).

    Rows: k; k y; -k x; -c spin, with k and c of eq. (8).
    """
    x, y, spins = (np.asarray(value, float) for value in (x_m, y_m, spin))
    if not x.shape == y.shape == spins.shape or x.ndim != 1:
        raise InputError(
            f"the mixer needs one x, y and spin per rotor; got {x.size}, {y.size} and {spins.size} "
            f"values"
        )
    return np.array([np.full(x.size, k_N_s2), k_N_s2 * y, -k_N_s2 * x, -c_Nm_s2 * spins])


@expression
def pitch_moment_Nm(thrust_N: Quantity, x_m: Quantity) -> Quantity:
    """Return -sum x_i T_i over rotors (n, ...), positive nose down: N m.

    Ground effect under the front rotors alone makes it negative (nose up).
    """
    total = 0.0 * thrust_N[0]
    for i in range(len(x_m)):
        total = total - x_m[i] * thrust_N[i]
    return total
