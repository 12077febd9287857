"""Damping of the hinge, proportional to its rate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import (
    BenchKind,
    Effect,
    Flow,
    Hooks,
    Quantity,
    expression,
    number,
)
from benchtool.physics.size import torque_scale


class P(NamedTuple):
    damping_Nms: Any


@expression
def torque(p: P, i: int, flow: Flow) -> Quantity:
    """Return the damping torque about the hinge: N m."""
    return -p.damping_Nms * flow.rate_rad_s


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the damping that matters, in the measure of m g L: N m s."""
    return {"damping_Nms": 0.004 * torque_scale(rig)}


EFFECT = Effect(
    name="viscous_friction",
    title="Viscous friction",
    description="The hinge opposes motion in proportion to its rate.",
    subsystem="hinge",
    order=30,
    law="torque = -d rate",
    numbers=P,
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
    tolerance_of=tolerance_of,
)
