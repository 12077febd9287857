"""The moment that ground effect puts against a tilt of the whole vehicle (paper, section 2.4).

A tilted vehicle has its rotors at different heights; the lower ones gain more. The moment is about
the body's centre, which stays at its height, for rotors that each give T = m g / n along their axis
out of ground effect: n the number of rotors, no matter the tilt. Thrusts that also keep the height,
m g / (n cos(tilt)), give a moment greater by 1/cos(tilt).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchtool.core.array import Array
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig import Rig
from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model
from benchtool.simulate.flight.rigid_body import GRAVITY_M_S2


@dataclass(frozen=True, slots=True)
class Reading:
    """Name one reading of eqs. (3) and (4) under tilt.

    Attributes:
        title: for people, two short lines.
        rules: what of a `Model` it sets: tilt rule, body distance.
        body: whether the body term is in each rotor's thrust, as eq. (10) has it.
    """

    title: str
    rules: dict[str, str]
    body: bool = True


READINGS: dict[str, Reading] = {
    "images": Reading("eq. (4), images at $z_i + z_j$,\n$b$ half the diagonal", {}),
    "images_diagonal": Reading(
        "eq. (4), images at $z_i + z_j$,\n$b$ the diagonal (printed)", {"body_distance": "diagonal"}
    ),
    "rotors_only": Reading("rotors only, eq. (3),\nimages at $z_i + z_j$", {}, body=False),
    "vertical": Reading("eq. (4), inflow taken\nalong the vertical", {"tilt_rule": "vertical"}),
    "own_height": Reading("eq. (4), each rotor's\nown height in it", {"tilt_rule": "own_height"}),
}
"""The first is the physics; the others are named choices."""


def hover_authority_Nm(rig: Rig) -> float:
    """Return the largest pitch torque at hover thrust: half the rotors' lift at their arms.

    For a plus quadrotor L m g / 2: all of the front rotor's share to the rear.
    """
    arms = np.abs([rotor.x_m for rotor in rig.rotors])
    return float(arms.sum() * rig.body.mass_kg * GRAVITY_M_S2 / rig.n_rotors)


def restoring_moment_Nm(
    rig: Rig, z_over_R: Array, tilt_rad: Array, reading: str = "images", K_b: float = 2.0
) -> Array:
    """Return the moment against a tilt about the pitch axis, the whole vehicle over ground: N m.

    Each rotor gives m g over the number of rotors; (heights, tilts), positive against the tilt.

    Args:
        rig: the vehicle.
        z_over_R: height of its centre in rotor radii (h,).
        tilt_rad: (t,).
        reading: one of `READINGS`.
        K_b: body lift coefficient.

    Raises:
        InputError: a rotor would come nearer than half its radius, where the formulae end.
        UnknownChoice: no such reading.
    """
    if reading not in READINGS:
        raise UnknownChoice("reading of the formulae under tilt", reading, READINGS)
    rules: dict[str, Any] = {"wake_rule": "full", **READINGS[reading].rules}
    model = replace(Model.single(rig).with_effect("neighbour_images"), **rules)
    if READINGS[reading].body:
        model = model.with_effect("body_lift", K_b=K_b)
    radius = rig.propulsion.radius_m
    z, tilt = np.meshgrid(np.asarray(z_over_R, float) * radius, tilt_rad, indexing="ij")
    conditions = Conditions.of(
        rig,
        speed_rad_s=np.ones(rig.n_rotors),
        plate_z_m=np.ravel(z / np.cos(tilt)),  # along the rotor axis
        plate_tilt_rad=np.ravel(tilt),
        coverage=np.ones((rig.n_discs, 1)),
    )
    nearest = float(np.min(model.z_over_R(conditions)))
    if not nearest >= model.nearest_z_over_R:
        raise InputError(
            f"a rotor comes to z/R = {nearest:.3g}, below {model.nearest_z_over_R:g} where the "
            f"formulae end; give a greater height or less tilt"
        )
    values = model.parameters.values_array()
    factors = np.array(model.disc_factors(model.flow(conditions, values), values))
    rotors_on = np.bincount(rig.disc_of_rotor, minlength=rig.n_discs)
    share_N = rotors_on * rig.body.mass_kg * GRAVITY_M_S2 / rig.n_rotors
    moment: Array = (rig.disc_positions_m[:, 0] * share_N) @ (factors - 1.0)
    return moment.reshape(z.shape)
