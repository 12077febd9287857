"""The vehicle does not hang from its centre of gravity."""

from __future__ import annotations

from collections.abc import Mapping

from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import BenchKind, Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression
from benchtool.physics.size import arm_scale


@expression
def torque(flow: Flow, p: Values) -> Quantity:
    """Return the torque of the weight about the hinge, positive nose down: N m."""
    return flow.weight_N * p[0] * flow.cos_pitch


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the offset that matters, in the measure of the arm: m."""
    return {"x_m": 0.0005 * arm_scale(rig)}


EFFECT = Effect(
    name="cog_offset",
    title="Centre-of-gravity offset",
    description="The centre of gravity lies in front of the hinge or behind it.",
    stage="hinge",
    law="torque = m g x cos(pitch)",
    parameters=(
        Parameter(
            "x_m",
            "m",
            0.0,
            neutral=0.0,
            lower=-0.1,
            upper=0.1,
            description="centre of gravity in front of the hinge, in the rotor plane",
            source="neutral value",
        ),
    ),
    shows="always; a constant torque that thrust does not scale",
    source="statics",
    confused_with={
        "rotor_asymmetry": "collective steps of 10 % separate them",
        "hinge_spring": "angles of both signs separate them",
    },
    benches=frozenset({"pitch"}),
    tolerance_of=tolerance_of,
    torque=torque,
)
