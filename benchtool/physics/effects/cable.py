"""Cable torque on the hinge: a spring with a dead zone."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.expression import at_least, at_most, unless_zero
from benchtool.physics.rig_scaling import scale_rig, torque_scale


def torque(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return the torque of the cable about the hinge: N m."""
    in_slack = at_most(at_least(flow.pitch_rad, -p.slack_rad), p.slack_rad)
    stiffness = p.stiffness_Nm_per_rad
    return unless_zero(stiffness, -stiffness * (flow.pitch_rad - in_slack))


EFFECT = Effect(
    name="cable",
    description="A cable exerts a restoring torque beyond its slack angle.",
    subsystem="hinge",
    order=60,
    law="torque = -k (pitch - clip(pitch, -slack, slack))",
    parameters=(
        number(
            "stiffness_Nm_per_rad", "N m/rad", 0.0, "stiffness of the taut cable", neutral=0.0,
            within=(0.0, 20.0),
        ),
        number(
            "slack_rad", "rad", 0.1, "pitch angle at which the cable is taut", within=(0.0, 1.5),
            source="assumed",
        ),
    ),
    hooks=Hooks(torque=torque),
    shows="large angles only",
    source="assumed: spring with a dead zone",
    confused_with={"hinge_spring": "small angles separate them"},
    benches=frozenset(),
    always_compiled=True,
    acts_in_flight=False,
    tolerance_of=scale_rig(torque_scale, stiffness_Nm_per_rad=0.02),
)  # fmt: skip
