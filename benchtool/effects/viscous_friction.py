"""Damping of the hinge, proportional to its rate."""

from __future__ import annotations

from benchtool.aero.expression import expression
from benchtool.core.parameter import Parameter
from benchtool.effects.effect import Effect, Flow, Quantity, Values


@expression
def torque(flow: Flow, p: Values) -> Quantity:
    """Return the damping torque about the hinge: N m."""
    return -p[0] * flow.rate_rad_s


EFFECT = Effect(
    name="viscous_friction",
    title="Viscous friction",
    description="The hinge opposes motion in proportion to its rate.",
    stage="hinge",
    law="torque = -d rate",
    parameters=(
        Parameter(
            "damping_Nms",
            "N m s",
            0.0,
            neutral=0.0,
            lower=0.0,
            upper=10.0,
            tolerance=0.004,
            description="damping of the hinge",
            source="neutral value",
        ),
    ),
    shows="fast motion at any throttle",
    source="linear damping, the usual first approximation of a greased bearing",
    confused_with={
        "coulomb_friction": "fast and slow motion separate them",
        "aerodynamic_damping": "several collectives separate them",
    },
    torque=torque,
)
