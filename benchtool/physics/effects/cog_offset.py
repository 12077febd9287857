"""Offset of the centre of gravity from the hinge."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.expression import unless_zero
from benchtool.physics.rig_scaling import arm_scale, scale_rig


def torque(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return the torque of the weight about the hinge, positive nose down: N m."""
    return unless_zero(p.x_m, flow.weight_N * p.x_m * flow.cos_pitch)


EFFECT = Effect(
    name="cog_offset",
    title="Centre-of-gravity offset",
    description="The centre of gravity is in front of or behind the hinge.",
    subsystem="hinge",
    order=70,
    law="torque = m g x cos(pitch)",
    parameters=(
        number(
            "x_m", "m", 0.0, "centre of gravity forward of the hinge, in the rotor plane",
            neutral=0.0, within=(-0.1, 0.1),
        ),
    ),
    hooks=Hooks(torque=torque),
    shows="always; a constant torque, independent of thrust",
    source="statics",
    confused_with={
        "rotor_asymmetry": "collective steps of 10 % separate them",
        "hinge_spring": "angles of both signs separate them",
    },
    benches=frozenset({"pitch"}),
    always_compiled=True,
    tolerance_of=scale_rig(arm_scale, x_m=0.0005),
)  # fmt: skip
