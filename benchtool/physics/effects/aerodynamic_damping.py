"""Aerodynamic damping of the pitch rate by the rotors."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.expression import at_least, unless_zero


def torque(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return the torque from thrust lost by rising and gained by sinking rotors: N m."""
    total = 0.0 * flow.rate_rad_s
    for j in range(len(flow.thrust_N)):
        tip_m_s = at_least(flow.speed_rad_s[j] * p.blade_radius_m, 1e-9)
        arm_m = flow.position_x_m[j]
        total = total + arm_m * arm_m * flow.thrust_N[j] / tip_m_s
    return unless_zero(p.coefficient, -p.coefficient * flow.rate_rad_s * total)


EFFECT = Effect(
    name="aerodynamic_damping",
    description="A rising rotor loses thrust, a sinking rotor gains thrust.",
    subsystem="hinge",
    order=40,
    law="torque = -c rate sum_i x_i^2 T_i / (speed_i r), r the blade's radius",
    parameters=(
        number(
            "coefficient", "1", 0.0,
            "relative thrust loss over climb speed, in tip speeds", neutral=0.0,
            within=(0.0, 20.0), tolerance=0.5,
        ),
        number(
            "blade_radius_m", "m", 0.12,
            "blade radius for the tip speed: geometric, not R_m", within=(1e-3, 10.0),
            source="convention: 24 cm propeller; else from the rig",
        ),
    ),
    hooks=Hooks(torque=torque),
    shows="fast motion; grows with the collective",
    source="blade-element theory to first order; assumed: 3 to 5 for small rotors",
    confused_with={"viscous_friction": "several collectives separate them"},
    benches=frozenset({"pitch"}),
    always_compiled=True,
    rig_values=lambda rig: {"blade_radius_m": rig.propulsion.radius_m},
)  # fmt: skip
