"""Viscous friction of the hinge."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.rig_scaling import scale_rig, torque_scale


def torque(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return the viscous torque about the hinge: N m."""
    return -p.damping_Nms * flow.rate_rad_s


EFFECT = Effect(
    name="viscous_friction",
    description="The friction torque of the hinge is proportional to its rate.",
    subsystem="hinge",
    order=30,
    law="torque = -d rate",
    parameters=(
        number(
            "damping_Nms", "N m s", 0.0, "damping of the hinge", neutral=0.0, within=(0.0, 10.0)
        ),
    ),
    hooks=Hooks(torque=torque),
    shows="fast motion at any throttle",
    source="linear damping, the usual first approximation of a greased bearing",
    confused_with={
        "coulomb_friction": "fast and slow motion separate them",
        "aerodynamic_damping": "several collectives separate them",
    },
    benches=frozenset({"pitch"}),
    always_compiled=True,
    acts_in_flight=False,
    tolerance_of=scale_rig(torque_scale, damping_Nms=0.004),
)
