"""Image sources of rotors: ground effect of one rotor and of several (eq. 1 to 3).

Each rotor is a source of strength R^2 v / 4 (v its induced velocity), mirrored below the plate. The
image of a rotor at distance d induces the upward velocity v (R^2/2) z / (d^2 + 4 z^2)^(3/2) at a
rotor at the same height z; for other heights see `tilt`. At equal power, thrust times inflow is
constant, so T_IGE/T_OGE = 1 / (1 - D) with D the sum of all images over v. The paper derives this
for equal power and applies it at equal rotor speed (eq. 10), as does this module unless the rig
defines its blades (`effects.blade_inflow`).

Source: Sanchez-Cuevas, Heredia, Ollero 2017, sections 2.1 and 2.2; the sum over any number of
rotors follows from the same derivation.
"""

from __future__ import annotations

import numpy as np

from benchtool.physics.expression import Quantity, expression


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
    return 1.0 + area * (factor - 1.0)


@expression
def clamped_height(z_m: Quantity, min_m: Quantity) -> Quantity:
    """Return the height, clipped to the minimum at which a law is valid: m.

    For simulators only, which count the clipped steps. A fit never clips: by default it excludes
    such points and reports their number.
    """
    return np.maximum(z_m, min_m)
