"""Rotors damp the motion of their own axes."""

from __future__ import annotations

import numpy as np

from benchtool.core.parameter import Parameter
from benchtool.physics.effects.effect import Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression


@expression
def torque(flow: Flow, p: Values) -> Quantity:
    """Return the torque of what rising rotors lose and sinking ones gain: N m."""
    total = 0.0 * flow.rate_rad_s
    for i in range(len(flow.thrust_N)):
        tip_m_s = np.maximum(flow.speed_rad_s[i] * flow.radius_m, 1e-9)
        arm_m = flow.position_x_m[i]
        total = total + arm_m * arm_m * flow.thrust_N[i] / tip_m_s
    return -p[0] * flow.rate_rad_s * total


EFFECT = Effect(
    name="aerodynamic_damping",
    title="Aerodynamic damping",
    description="A rotor that moves up loses thrust; one that moves down gains some.",
    stage="hinge",
    law="torque = -c rate sum_i x_i^2 T_i / (speed_i R)",
    parameters=(
        Parameter(
            "coefficient",
            "1",
            0.0,
            neutral=0.0,
            lower=0.0,
            upper=20.0,
            tolerance=0.5,
            description="relative loss of thrust over climb speed in units of the tip speed",
            source="neutral value",
        ),
    ),
    shows="fast motion; grows with the collective",
    source="blade-element theory to first order; about 3 to 5 is usual for small rotors (a guess)",
    confused_with={"viscous_friction": "several collectives separate them"},
    benches=frozenset({"pitch"}),
    torque=torque,
)
