"""Effects that somebody else wrote: a magnet that pulls the beam towards an angle, and a lag."""

from __future__ import annotations

from typing import Any

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number


@expression
def torque(p: Any, i: int, flow: Flow) -> Quantity:
    """Pull towards the angle."""
    return p.k_Nm_per_rad * (p.angle_rad - flow.pitch_rad)


@expression
def lag_s(p: Any, i: int, flow: Flow) -> Quantity:
    return p.tau_s


MAGNET = Effect(
    name="magnet",
    title="Magnet",
    description="A magnet pulls.",
    subsystem="hinge",
    law="torque = k (angle - pitch)",
    parameters=(
        number("k_Nm_per_rad", "N m/rad", 0.5, "stiffness", neutral=0.0, tolerance=0.01),
        number("angle_rad", "rad", 0.1, "where it pulls to"),
    ),
    hooks=Hooks(torque=torque),
    shows="always",
    source="made up",
    confused_with={},
)

SLUGGISH = Effect(
    name="sluggish",
    title="Second lag",
    description="One more lag.",
    subsystem="pwm_to_rpm",
    law="lag",
    parameters=(number("tau_s", "s", 0.1, "time constant", neutral=0.0, tolerance=0.01),),
    hooks=Hooks(lag_s=lag_s),
    shows="always",
    source="made up",
    confused_with={},
)
