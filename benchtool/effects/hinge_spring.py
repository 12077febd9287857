"""Something springy pulls the beam back to level."""

from __future__ import annotations

from benchtool.aero.expression import expression
from benchtool.core.parameter import Parameter
from benchtool.effects.effect import Effect, Flow, Quantity, Values


@expression
def torque(flow: Flow, p: Values) -> Quantity:
    """Return the torque of the spring about the hinge: N m."""
    return -p[0] * flow.pitch_rad


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
            tolerance=0.02,
            description="stiffness about level",
            source="neutral value",
        ),
    ),
    shows="large angles held for long",
    source="linear spring about the level beam",
    confused_with={"cog_offset": "angles of both signs separate them"},
    torque=torque,
)
