"""The moment that ground effect puts against a tilt of the whole vehicle (paper, section 2.4).

A tilted vehicle has its rotors at different heights; the lower ones gain more. Every rotor gives an
equal share of the thrust that keeps the height at that tilt, m g / cos(tilt), and enters the
formulae with its own height. With the body's term inside each rotor's thrust, as eq. (10) has it,
the moment is several times that of the images alone; a lift that acts on the body acts at the
centre and gives none. Both readings are here.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal, get_args

import numpy as np

from benchtool.core.array import Array
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig import Rig
from benchtool.physics.expression import Quantity, expression
from benchtool.physics.model import Model
from benchtool.simulate.flight.rigid_body import GRAVITY_M_S2

BodyReading = Literal["per_rotor", "per_rotor_diagonal", "rotors_only"]
"""Body term in every rotor's thrust (b half the diagonal, or all of it), or at the centre only."""

READINGS: dict[str, str] = {
    "per_rotor": "eq. (4) in every rotor's thrust, b half the diagonal",
    "per_rotor_diagonal": "eq. (4) in every rotor's thrust, b the diagonal as printed",
    "rotors_only": "rotors only, eq. (3): the body's lift acts at the centre",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class AttitudeMoment:
    """Hold the restoring moment of one reading.

    Attributes:
        reading: which.
        moment_Nm: (heights, tilts), positive against the tilt.
    """

    reading: BodyReading
    moment_Nm: Array


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


def hover_authority_Nm(rig: Rig) -> float:
    """Return the largest pitch torque at hover thrust: half the rotors' lift at their arms.

    For a plus quadrotor L m g / 2: all of the front rotor's share to the rear.
    """
    arms = np.abs([rotor.x_m for rotor in rig.rotors])
    return float(arms.sum() * rig.body.mass_kg * GRAVITY_M_S2 / rig.n_rotors)


def restoring_moment(
    rig: Rig, z_over_R: Array, tilt_rad: Array, reading: BodyReading = "per_rotor", K_b: float = 2.0
) -> AttitudeMoment:
    """Return the moment against a tilt about the pitch axis, the whole vehicle over ground.

    Args:
        rig: the vehicle.
        z_over_R: height of its centre in rotor radii (h,).
        tilt_rad: (t,).
        reading: how the body's term acts.
        K_b: body lift coefficient.

    Raises:
        InputError: a rotor would come nearer than half its radius, where the formulae end.
    """
    if reading not in get_args(BodyReading):
        raise UnknownChoice("reading of the body term", reading, get_args(BodyReading))
    radius = rig.propulsion.radius_m
    z, tilt = np.meshgrid(np.asarray(z_over_R, float) * radius, tilt_rad, indexing="ij")
    places = rig.disc_positions_m
    heights = np.array([tilted_vehicle_height(z, x, y, tilt, 0.0) for x, y in places])
    if not np.all(heights >= 0.5 * radius):
        raise InputError(
            f"a rotor comes to z/R = {np.nanmin(heights) / radius:.3g}, below 0.5 where the "
            f"formulae end; give a greater height or less tilt"
        )
    model = replace(
        Model.single(rig).with_effect("neighbour_images"),
        wake_rule="full",
        body_distance="diagonal" if reading == "per_rotor_diagonal" else "half_diagonal",
    )
    if reading != "rotors_only":
        model = model.with_effect("body_lift", K_b=K_b)
    factors = model.factors_at(heights)
    rotors_on = np.bincount(rig.disc_of_rotor, minlength=rig.n_discs)
    share = rotors_on * rig.body.mass_kg * GRAVITY_M_S2 / rig.n_rotors
    moment = np.einsum("d,dht->ht", places[:, 0] * share, factors - 1.0) / np.cos(tilt)
    return AttitudeMoment(reading=reading, moment_Nm=moment)
