"""Something springy pulls the beam back to level."""

from __future__ import annotations

from collections.abc import Mapping

from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import BenchKind, Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression
from benchtool.physics.size import torque_scale


@expression
def torque(flow: Flow, p: Values) -> Quantity:
    """Return the torque of the spring about the hinge: N m."""
    return -p[0] * flow.pitch_rad


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the stiffness that matters, in the measure of m g L: N m/rad."""
    return {"stiffness_Nm_per_rad": 0.02 * torque_scale(rig)}


EFFECT = Effect(
    name="hinge_spring",
    title="Hinge spring",
    description="A cable, a flexure or a bearing seal pulls the beam back to level.",
    stage="hinge",
    law="torque = -k pitch",
    parameters=(
        Parameter(
            "stiffness_Nm_per_rad",
            "N m/rad",
            0.0,
            neutral=0.0,
            lower=-5.0,
            upper=20.0,
            description="stiffness about level",
            source="neutral value",
        ),
    ),
    shows="large angles held for long",
    source="linear spring about the level beam",
    confused_with={"cog_offset": "angles of both signs separate them"},
    benches=frozenset({"pitch"}),
    tolerance_of=tolerance_of,
    torque=torque,
)
