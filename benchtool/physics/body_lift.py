"""Body lift in the upwash between the rotors: the added term of eq. (4).

The term is the velocity of all images at the body's centre (`effects.body_lift`), times an
empirical K_b ("close to 2").
Its factor 2 R^2 corresponds to four images at half the diagonal, so b is half the diagonal by the
derivation; the paper's text calls b the diagonal. Both are available, half is the default.
"""

from __future__ import annotations

from typing import Literal, NamedTuple, get_args

import numpy as np

from benchtool.core.errors import UnknownChoice
from benchtool.core.units import Array
from benchtool.physics.expression import Quantity

BodyDistance = Literal["half_diagonal", "diagonal"]  # b of eq. (4): to a rotor axis, or twice that


class BodyImages(NamedTuple):
    """Positions of the body term's sources in the rotor plane, and their distances (k,): m."""

    x_m: Quantity
    y_m: Quantity
    arm_m: Quantity


def body_images(
    x_m: Array,
    y_m: Array,
    body_distance: BodyDistance = "half_diagonal",
    half_diagonal_m: float | None = None,
) -> BodyImages:
    """Return the sources of the body term for rotors at (x, y) (n,) about the body's centre.

    For any layout: "half_diagonal" places them at the rotors, "diagonal" at twice their arms, in
    the same plane. With `half_diagonal_m` they are the four rotors of a plus layout.
    """
    if body_distance not in get_args(BodyDistance):
        raise UnknownChoice("body distance", body_distance, get_args(BodyDistance))
    if half_diagonal_m is not None:
        x_m = half_diagonal_m * np.array([1.0, 0.0, -1.0, 0.0])
        y_m = np.roll(x_m, 1)
    factor = 2.0 if body_distance == "diagonal" else 1.0
    return BodyImages(factor * x_m, factor * y_m, factor * np.hypot(x_m, y_m))
