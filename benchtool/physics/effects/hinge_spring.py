"""Something springy pulls the beam back to level."""

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
    stiffness_Nm_per_rad: Any


@expression
def torque(p: P, i: int, flow: Flow) -> Quantity:
    """Return the torque of the spring about the hinge: N m."""
    return -p.stiffness_Nm_per_rad * flow.pitch_rad


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the stiffness that matters, in the measure of m g L: N m/rad."""
    return {"stiffness_Nm_per_rad": 0.02 * torque_scale(rig)}


EFFECT = Effect(
    name="hinge_spring",
    title="Hinge spring",
    description="A cable, a flexure or a bearing seal pulls the beam back to level.",
    subsystem="hinge",
    order=50,
    law="torque = -k pitch",
    numbers=P,
    parameters=(
        number(
            "stiffness_Nm_per_rad",
            "N m/rad",
            0.0,
            "stiffness about level",
            neutral=0.0,
            within=(-5.0, 20.0),
        ),
    ),
    hooks=Hooks(torque=torque),
    shows="large angles held for long",
    source="linear spring about the level beam",
    confused_with={"cog_offset": "angles of both signs separate them"},
    benches=frozenset({"pitch"}),
    always_compiled=True,
    acts_in_flight=False,
    tolerance_of=tolerance_of,
)
