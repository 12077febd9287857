"""An effect that somebody else wrote: a magnet that pulls the beam towards an angle."""

from __future__ import annotations

from benchtool.core.parameter import Parameter
from benchtool.physics.effects.effect import Effect, Flow, OwnState, Quantity, Values
from benchtool.physics.expression import expression


@expression
def torque(flow: Flow, p: Values) -> Quantity:
    """Pull towards p[1] with stiffness p[0]."""
    return p[0] * (p[1] - flow.pitch_rad)


@expression
def rate(state: Quantity, drive: Quantity, p: Values) -> Quantity:
    return (drive - state) / p[0]


@expression
def settled(drive: Quantity, elapsed_s: Quantity, p: Values) -> Quantity:
    return drive


MAGNET = Effect(
    name="magnet",
    title="Magnet",
    description="A magnet pulls.",
    stage="hinge",
    law="torque = k (angle - pitch)",
    parameters=(
        Parameter("k_Nm_per_rad", "N m/rad", 0.5, neutral=0.0, tolerance=0.01),
        Parameter("angle_rad", "rad", 0.1),
    ),
    shows="always",
    source="made up",
    confused_with={},
    torque=torque,
)

SLUGGISH = Effect(
    name="sluggish",
    title="Second lag",
    description="One more lag.",
    stage="pwm_to_rpm",
    law="lag",
    parameters=(Parameter("tau_s", "s", 0.1, neutral=0.0, tolerance=0.01),),
    shows="always",
    source="made up",
    confused_with={},
    states=(OwnState(name="speed", drive="speed_rad_s", rate=rate, settled=settled),),
)
