"""Heights of rotors over a tilted plate, and of a tilted vehicle over level ground.

Axes as in `mixer`: x forward, y left, z up, origin at the body's centre in the rotor plane.
"""

from __future__ import annotations

import numpy as np

from benchtool.physics.expression import Quantity, expression


@expression
def tilted_plate_height(
    z_m: Quantity, x_m: Quantity, y_m: Quantity, tilt_y_rad: Quantity, tilt_x_rad: Quantity
) -> Quantity:
    """Return the perpendicular distance from a rotor at (x, y) to a tilted plate: m.

    Args:
        z_m: plate distance along the rotor axis at the body's centre: m.
        x_m: rotor place, forward: m.
        y_m: rotor place, left: m.
        tilt_y_rad: tilt about the body's y axis; positive brings the +x rotors nearer.
        tilt_x_rad: tilt about the x axis; positive brings the +y rotors nearer.

    With one tilt a this is z cos(a) - x sin(a). Each image lies across the plate on its normal;
    the small turn of the images' velocity against the rotor axis (cos a) is left out.
    """
    cos_x = np.cos(tilt_x_rad)
    return (
        z_m * np.cos(tilt_y_rad) * cos_x
        - x_m * np.sin(tilt_y_rad) * cos_x
        - y_m * np.sin(tilt_x_rad)
    )


@expression
def tilted_vehicle_height(
    z_m: Quantity, x_m: Quantity, y_m: Quantity, pitch_rad: Quantity, roll_rad: Quantity
) -> Quantity:
    """Return the height of a rotor at (x, y) of a tilted vehicle over level ground: m.

    Args:
        z_m: height of the body's centre: m.
        x_m: rotor place, forward: m.
        y_m: rotor place, left: m.
        pitch_rad: pitch, positive nose down.
        roll_rad: roll after pitch, positive left side up.

    With pitch alone this is z - x sin(pitch). Source: paper, section 2.4 (each rotor's own height).
    """
    return z_m - x_m * np.sin(pitch_rad) + y_m * np.cos(pitch_rad) * np.sin(roll_rad)


def rotor_heights_m(
    z_m: Quantity,
    x_m: Quantity,
    y_m: Quantity,
    tilt_y_rad: Quantity = 0.0,
    tilt_x_rad: Quantity = 0.0,
) -> list[Quantity]:
    """Return `tilted_plate_height` of every rotor: n entries, each of the shape of z: m."""
    return [
        tilted_plate_height(z_m, x, y, tilt_y_rad, tilt_x_rad)
        for x, y in zip(x_m, y_m, strict=True)
    ]
