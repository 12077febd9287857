"""Rotors over a surface: image velocities, level and under tilt (eq. 1 to 3), and covered areas.

Each rotor is a source of strength R^2 v / 4 (v its induced velocity), mirrored below the plate. The
image of a rotor at distance d induces the upward velocity v (R^2/2) z / (d^2 + 4 z^2)^(3/2) at a
rotor at the same height z. At equal power, thrust times inflow is constant, so
T_IGE/T_OGE = 1 / (1 - D) with D the sum of all images over v. The paper derives this for equal
power and applies it at equal rotor speed (eq. 10), as does this module unless the rig defines its
blades (`effects.blade_inflow`).

Eqs. (3) and (4) are derived for one height z; the paper does not define the heights under tilt. By
the method of images, the image of a rotor at height z_j is z_i + z_j below a rotor at height z_i,
at the horizontal distance of the tilted positions. With d the distance in the rotor plane, the
squared total distance is d^2 + 4 z_i z_j. `TILT_RULES` contains alternatives; level, all of them
are eqs. (3) and (4).

Fractions of a rotor disc over a half plane or a rectangle are exact areas. A tilted disc projects
to an ellipse; the difference (1.5 % of the area at 10 degrees) is ignored. Roots are of
(1 - u)(1 + u), not 1 - u^2, for full precision of a disc that just touches the edge.

Source: Sanchez-Cuevas, Heredia, Ollero 2017, sections 2.1 and 2.2; the sum over any number of
rotors follows from the same derivation.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchtool.core.errors import UnknownChoice
from benchtool.physics.expression import Quantity, at_least, at_most, expression, unless_zero


@expression
def image_velocity(here_m: Quantity, there_m: Quantity, distance_m: Quantity) -> Quantity:
    """Return z_j / (2 (d^2 + 4 z_i z_j)^(3/2)): 1/m2.

    Times R^2 and the cosine of the tilt, this is the velocity along the rotor axis at height z_i,
    over the induced velocity, from the image of a rotor at height z_j and distance d in the rotor
    plane. Level and at d = 0, times R^2, it is (R/4z)^2.
    """
    squared = distance_m * distance_m + 4.0 * (here_m * there_m)
    return 0.5 * there_m / (squared * np.sqrt(squared))


@expression
def self_image(z_m: Quantity) -> Quantity:
    """Return 1 / (16 z^2), the contribution of a rotor's own image per R^2 (eq. 2): 1/m2."""
    return 0.0625 / (z_m * z_m)


@expression
def thrust_factor(denominator_sum: Quantity) -> Quantity:
    """Return T_IGE/T_OGE = 1 / (1 - D) for the sum D of the denominator's terms (eq. 2 to 4)."""
    return 1.0 / (1.0 - denominator_sum)


@expression
def partial_factor(factor: Quantity, area: Quantity) -> Quantity:
    """Return 1 + a (F - 1): the increment F - 1 is linear in the covered fraction a.

    Source: section 3.1 of the paper, after measurements on a helicopter rotor (its reference 36).
    """
    return 1.0 + unless_zero(area, area * (factor - 1.0))


@expression
def clamped_height(z_m: Quantity, min_m: Quantity) -> Quantity:
    """Return the height, clipped to the minimum at which a law is valid: m.

    For simulators only, which count the clipped steps. A fit never clips: by default it excludes
    such points and reports their number.
    """
    return at_least(z_m, min_m)


class Plane(NamedTuple):
    """Distance of the body's centre to a surface, along its normal (...): m; slopes of the distance
    forward (+x) and to the left (+y) in the rotor plane.
    """

    centre_m: Quantity = 0.0
    slope_x: Quantity = 0.0
    slope_y: Quantity = 0.0


LEVEL = Plane()  # for flows that need no heights


@expression
def plate_plane(z_m: Quantity, plate_x_m: Quantity, tilt_rad: Quantity) -> Plane:
    """Return the plane of a tilted plate under a level rotor plane.

    The pivot is the plate's centre, whose distance along the rotor axis is unchanged: the distance
    of a disc at x is z cos(tilt) - (x - x_plate) sin(tilt).

    Args:
        z_m: distance from the rotor plane to the plate's centre, along the rotor axis: m.
        tilt_rad: about the y axis; positive brings +x rotors nearer.
    """
    sine = np.sin(tilt_rad)
    return Plane(z_m * np.cos(tilt_rad) + plate_x_m * sine, -sine, 0.0)


@expression
def height_over(plane: Plane, x_m: Quantity, y_m: Quantity) -> Quantity:
    """Return the distance of a point of the rotor plane to the surface: m."""
    return plane.centre_m + plane.slope_x * x_m + plane.slope_y * y_m


@expression
def axis_cosine(plane: Plane) -> Quantity:
    """Return the cosine of the angle between the rotor axis and the surface's normal."""
    return np.sqrt(1.0 - plane.slope_x * plane.slope_x - plane.slope_y * plane.slope_y)


@dataclass(frozen=True, slots=True)
class TiltRule:
    """Rule for image velocities under tilt; functions are expressions."""

    # image(here, there, distance) -> velocity at height `here` from the image of a source at height
    # `there`, per R^2 and before `share`: 1/m2
    image: Callable[[Quantity, Quantity, Quantity], Quantity]
    # share(cosine) -> factor on it, also for a rotor's own image; `cosine` is that of the angle
    # between the rotor axis and the surface normal
    share: Callable[[Quantity], Quantity]
    # True if the body term is evaluated once at the centre's height, False if at the height of each
    # rotor
    one_body: bool


@expression
def vertical_image(here_m: Quantity, there_m: Quantity, distance_m: Quantity) -> Quantity:
    """Return the velocity along the surface normal: (z_i + z_j)/2 in place of z_j.

    This is the direction of the level derivation; velocities of real neighbours are ignored.
    """
    axial = image_velocity(here_m, there_m, distance_m)
    return 0.5 * (axial + image_velocity(there_m, here_m, distance_m))


@expression
def own_height_image(here_m: Quantity, there_m: Quantity, distance_m: Quantity) -> Quantity:
    """Return the velocity from an image at the height of the point itself.

    Eq. (10) as printed, f_GE(z_r,i). Not physical: positions of images and of the body's centre
    then depend on the rotor in question.
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
    # Thrust times axial inflow is constant; real neighbours in the rotor plane induce no axial one
    "axis": TiltRule(image_velocity, cosine_share, True),
    "vertical": TiltRule(vertical_image, whole_share, True),
    "own_height": TiltRule(own_height_image, whole_share, False),
}


def tilt_rule(name: str) -> TiltRule:
    """Return the tilt rule of that name."""
    if name not in TILT_RULES:
        raise UnknownChoice("tilt rule", name, TILT_RULES)
    return TILT_RULES[name]


@expression
def half_plane_coverage(inside_m: Quantity, radius_m: Quantity) -> Quantity:
    """Return the covered fraction of a disc whose centre is `inside_m` inside a straight edge.

    The area is R^2 (pi - arccos(s/R)) + s sqrt(R^2 - s^2), s clipped to -R to R.
    """
    u = at_most(at_least(inside_m / radius_m, -1.0), 1.0)
    return 1.0 + (u * np.sqrt((1.0 - u) * (1.0 + u)) - np.arccos(u)) / np.pi


@expression
def half_disc_integral(u: Quantity) -> Quantity:
    """Return the integral of sqrt(1 - t^2) from 0 to u, for -1 <= u <= 1."""
    return 0.5 * (u * np.sqrt((1.0 - u) * (1.0 + u)) + np.arcsin(u))


@expression
def corner_integral(u: Quantity, v: Quantity) -> Quantity:
    """Return the integral over t from 0 to u of v clipped to the unit disc; |u| and |v| up to 1.

    The clipped ordinate is v for |t| <= c = sqrt(1 - v^2), else the edge of the disc. The integral
    is v clip(u, -c, c) plus the half disc beyond c with the sign of v; odd in u and v.
    """
    c = np.sqrt((1.0 - v) * (1.0 + v))
    beyond = half_disc_integral(at_least(u, c)) + half_disc_integral(at_most(u, -c))
    return v * at_most(at_least(u, -c), c) + np.sign(np.real(v)) * beyond


@expression
def rectangle_coverage(
    x_m: Quantity,
    y_m: Quantity,
    radius_m: Quantity,
    x1_m: Quantity,
    x2_m: Quantity,
    y1_m: Quantity,
    y2_m: Quantity,
) -> Quantity:
    """Return the covered fraction of a disc centred at (x, y) over [x1, x2] x [y1, y2].

    Sides may be infinite. The four corner integrals are exact; verified with the half-plane
    formula, the corner formula of the circle and Monte Carlo.
    """
    u1 = at_most(at_least((x1_m - x_m) / radius_m, -1.0), 1.0)
    u2 = at_most(at_least((x2_m - x_m) / radius_m, -1.0), 1.0)
    v1 = at_most(at_least((y1_m - y_m) / radius_m, -1.0), 1.0)
    v2 = at_most(at_least((y2_m - y_m) / radius_m, -1.0), 1.0)
    area = (
        corner_integral(u2, v2)
        - corner_integral(u1, v2)
        - corner_integral(u2, v1)
        + corner_integral(u1, v1)
    )
    return at_most(at_least(area / np.pi, 0.0), 1.0)
