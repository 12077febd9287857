"""Rotors at different heights: where the surface lies under them, and what images then blow.

Eqs. (3) and (4) were derived for one height z, and the paper does not say which heights enter them
under tilt. By the method of images the image of a rotor at height z_j lies z_i + z_j below a rotor
at height z_i, at the horizontal distance of the tilted places; with d the distance of the places in
the rotor plane, the square of the whole distance is d^2 + 4 z_i z_j. Other readings are choices by
name (`TILT_RULES`). In level flight all of them are eqs. (3) and (4).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchtool.core.errors import UnknownChoice
from benchtool.physics.expression import Quantity, expression
from benchtool.physics.images import image_velocity


class Plane(NamedTuple):
    """Hold the distance of the body's centre to a surface (...): m, measured at right angles to it;
    and how the distance grows per metre forward (+x) and to the left (+y) in the rotor plane.
    """

    centre_m: Quantity = 0.0
    slope_x: Quantity = 0.0
    slope_y: Quantity = 0.0


LEVEL = Plane()  # for flows that need no heights


@expression
def plate_plane(z_m: Quantity, plate_x_m: Quantity, tilt_rad: Quantity) -> Plane:
    """Return the plane of a tilted plate under a level rotor plane.

    The plate pivots about its own centre, whose distance along the rotor axis stays what was read:
    a disc at x is z cos(tilt) - (x - x_plate) sin(tilt) away.

    Args:
        z_m: distance from the rotor plane along its axis to the plate's centre: m.
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


@dataclass(frozen=True, slots=True)
class TiltRule:
    """Name one reading.

    Attributes:
        image: image(here, there, distance) -> velocity at height `here` from the image of a source
            at height `there`, per R^2 and before `share`: 1/m2, an expression.
        share: share(cosine) -> what counts of it, also of a rotor's own image; `cosine` is that of
            the angle between the rotor axis and the surface's normal. An expression.
        one_body: whether the body term is one number, taken at the centre's height; else it is
            taken at each rotor's own height.
    """

    image: Callable[[Quantity, Quantity, Quantity], Quantity]
    share: Callable[[Quantity], Quantity]
    one_body: bool


@expression
def vertical_image(here_m: Quantity, there_m: Quantity, distance_m: Quantity) -> Quantity:
    """Return the velocity at right angles to the surface: (z_i + z_j)/2 in place of z_j.

    The direction of the level derivation; real neighbours are left out.
    """
    along = image_velocity(here_m, there_m, distance_m)
    return 0.5 * (along + image_velocity(there_m, here_m, distance_m))


@expression
def own_height_image(here_m: Quantity, there_m: Quantity, distance_m: Quantity) -> Quantity:
    """Return the velocity from an image as deep as the place itself is high.

    Eq. (10) as printed, f_GE(z_r,i); no physics: images and the body's centre then move with the
    rotor that looks.
    """
    return image_velocity(here_m, here_m, distance_m)


@expression
def cosine_share(cosine: Quantity) -> Quantity:
    """Return the cosine."""
    return cosine


@expression
def whole_share(cosine: Quantity) -> Quantity:
    """Return 1."""
    return 1.0 + 0.0 * cosine


TILT_RULES: dict[str, TiltRule] = {
    # Thrust times axial inflow is constant, and real neighbours, in the rotor plane, give nothing.
    "axis": TiltRule(image_velocity, cosine_share, True),
    "vertical": TiltRule(vertical_image, whole_share, True),
    "own_height": TiltRule(own_height_image, whole_share, False),
}


def tilt_rule(name: str) -> TiltRule:
    """Return the rule of that name; an unknown name lists the known ones."""
    if name not in TILT_RULES:
        raise UnknownChoice("tilt rule", name, TILT_RULES)
    return TILT_RULES[name]
