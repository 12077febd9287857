"""Linear spring torque about the hinge."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.expression import unless_zero
from benchtool.physics.rig_scaling import scale_rig, torque_scale


def torque(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return the torque of the spring about the hinge: N m."""
    stiffness = p.stiffness_Nm_per_rad
    return unless_zero(stiffness, -stiffness * flow.pitch_rad)


EFFECT = Effect(
    name="hinge_spring",
    description="A cable, flexure or bearing seal exerts a restoring torque towards level.",
    subsystem="hinge",
    order=50,
    law="torque = -k pitch",
    parameters=(
        number(
            "stiffness_Nm_per_rad", "N m/rad", 0.0, "stiffness about level", neutral=0.0,
            within=(-5.0, 20.0),  # negative: centre of gravity above the hinge
        ),
    ),
    hooks=Hooks(torque=torque),
    shows="large pitch angles over a long time",
    source="linear spring about the level beam",
    confused_with={"cog_offset": "angles of both signs separate them"},
    benches=frozenset({"pitch"}),
    always_compiled=True,
    acts_in_flight=False,
    tolerance_of=scale_rig(torque_scale, stiffness_Nm_per_rad=0.02),
)  # fmt: skip
