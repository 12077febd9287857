"""How large a vehicle is, against the bench that the default tolerances were stated for.

What does not matter on a beam of 1.2 kg is absurd for a vehicle of 30 g and for one of 12 kg, so
that default tolerances go with weight, arm and radius. On that beam every scale here is 1.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from benchtool.core.rig import Rig

MASS_KG = 1.2  # mass of the bench whose owner stated the tolerances (rig `beam`)
ARM_M = 0.25  # its arm L from hinge to rotor axis
RADIUS_M = 0.127  # its rotor radius


def half_throttle_speed(rig: Rig) -> float:
    """Return the rotor speed in the middle of the pulses' range: rad/s."""
    p = rig.propulsion
    return 0.5 * p.speed_per_us_rad_s * (p.pwm_max_us - p.pwm_start_us)


def weight_scale(rig: Rig) -> float:
    """Return how much heavier the vehicle is than that bench's beam."""
    return rig.body.mass_kg / MASS_KG


def arm_scale(rig: Rig) -> float:
    """Return how much longer the arm about the pitch axis is; a radius where there is no arm."""
    arm_m = max(abs(place.x_m) for place in rig.rotors)
    return max(arm_m, rig.propulsion.radius_m) / ARM_M


def torque_scale(rig: Rig) -> float:
    """Return how much greater m g L is."""
    return weight_scale(rig) * arm_scale(rig)


def radius_scale(rig: Rig) -> float:
    """Return how much larger the rotors are."""
    return rig.propulsion.radius_m / RADIUS_M


def scale_rig(
    scale: Callable[[Rig], float], **on_the_beam: float
) -> Callable[[Rig, object], Mapping[str, float]]:
    """Return an effect's `tolerance_of`: tolerances on that beam, which grow with a scale."""
    return partial(_scaled, scale, on_the_beam)


def _scaled(
    scale: Callable[[Rig], float], on_the_beam: Mapping[str, float], rig: Rig, bench: object
) -> Mapping[str, float]:
    return {name: value * scale(rig) for name, value in on_the_beam.items()}
