"""Where a plane surface lies under the rotor plane: what heights under tilt follow from."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from benchtool.physics.expression import Quantity, expression


class Plane(NamedTuple):
    """Hold the distance of the body's centre to a surface (...): m, measured at right angles to it;
    and how the distance grows per metre forward (+x) and to the left (+y) in the rotor plane.
    """

    centre_m: Quantity = 0.0
    slope_x: Quantity = 0.0
    slope_y: Quantity = 0.0


LEVEL = Plane()
"""For flows that need no heights."""


@expression
def plate_plane(z_m: Quantity, plate_x_m: Quantity, tilt_rad: Quantity) -> Plane:
    """Return the plane of a tilted plate under a level rotor plane.

    The plate pivots about its own centre, whose distance along the rotor axis stays what was read:
    a disc at x is z cos(tilt) - (x - x_plate) sin(tilt) away.

    Args:
        z_m: distance from the rotor plane along its axis to the plate's centre: m.
        plate_x_m: lateral position of that centre: m.
        tilt_rad: about the y axis; positive brings +x rotors nearer.
    """
    sine = np.sin(tilt_rad)
    return Plane(z_m * np.cos(tilt_rad) + plate_x_m * sine, -sine, 0.0)


@expression
def height_over(plane: Plane, x_m: Quantity, y_m: Quantity) -> Quantity:
    """Return the distance to the surface of a place in the rotor plane: m."""
    return plane.centre_m + plane.slope_x * x_m + plane.slope_y * y_m


@expression
def axis_cosine(plane: Plane) -> Quantity:
    """Return the cosine of the angle between the rotor axis and the surface's normal."""
    return np.sqrt(1.0 - plane.slope_x * plane.slope_x - plane.slope_y * plane.slope_y)
