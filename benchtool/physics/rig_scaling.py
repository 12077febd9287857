"""Scale factors of a vehicle for default tolerances, relative to the rig `beam`.

Default tolerances were defined for a beam of 1.2 kg. For vehicles of 30 g or 12 kg they scale with
weight, arm and radius; for the beam every factor is 1.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from benchtool.core.rig import Rig

MASS_KG = 1.2  # of the rig `beam`
ARM_M = 0.25  # arm L of the rig `beam` from hinge to rotor axis
RADIUS_M = 0.127  # rotor radius of the rig `beam`


def half_throttle_speed(rig: Rig) -> float:
    """Return the rotor speed in the middle of the pulse width range: rad/s."""
    p = rig.propulsion
    return 0.5 * p.speed_per_us_rad_s * (p.pwm_max_us - p.pwm_start_us)


def weight_scale(rig: Rig) -> float:
    """Return the ratio of the vehicle's mass to that of the beam."""
    return rig.body.mass_kg / MASS_KG


def arm_scale(rig: Rig) -> float:
    """Return the ratio of the pitch arm to that of the beam; the arm is at least a radius."""
    arm_m = max(abs(rotor.x_m) for rotor in rig.rotors)
    return max(arm_m, rig.propulsion.radius_m) / ARM_M


def torque_scale(rig: Rig) -> float:
    """Return the ratio of m g L to that of the beam."""
    return weight_scale(rig) * arm_scale(rig)


def radius_scale(rig: Rig) -> float:
    """Return the ratio of the rotor radius to that of the beam."""
    return rig.propulsion.radius_m / RADIUS_M


def scale_rig(
    scale: Callable[[Rig], float], **beam_tolerances: float
) -> Callable[[Rig, object], Mapping[str, float]]:
    """Return an effect's `tolerance_of`: tolerances for the beam times a scale factor."""
    return lambda rig, bench: {name: value * scale(rig) for name, value in beam_tolerances.items()}
