"""The rotor layouts of eq. (9), for tests of the mixer and the images."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class RotorLayout(NamedTuple):
    """Positions and spins of rotors.

    Attributes:
        names: of the rotors, in the order of eq. (9).
        x_m: forward (n,): m.
        y_m: left (n,): m.
        spin: +1 counter-clockwise seen from above, -1 clockwise (n,).
    """

    names: tuple[str, ...]
    x_m: Array
    y_m: Array
    spin: Array


def plus_layout(arm_m: float) -> RotorLayout:
    """Return the layout of eq. (9): rotors 1 to 4 are front, left, rear, right at that arm.

    The paper calls the arm d in eq. (9), and the distance between adjacent axes d in eq. (3):
    the latter is arm times sqrt(2).
    """
    return RotorLayout(
        ("front", "left", "rear", "right"),
        np.array([arm_m, 0.0, -arm_m, 0.0]),
        np.array([0.0, arm_m, 0.0, -arm_m]),
        np.array([1.0, -1.0, 1.0, -1.0]),
    )
