"""Damping of the hinge, proportional to its rate."""

from __future__ import annotations

from collections.abc import Mapping

from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import BenchKind, Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression
from benchtool.physics.size import torque_scale


@expression
def torque(flow: Flow, p: Values) -> Quantity:
    """Return the damping torque about the hinge: N m."""
    return -p[0] * flow.rate_rad_s


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the damping that matters, in the measure of m g L: N m s."""
    return {"damping_Nms": 0.004 * torque_scale(rig)}


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
    benches=frozenset({"pitch"}),
    tolerance_of=tolerance_of,
    torque=torque,
)
