"""A cable that pulls when the beam turns far."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

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
    slack_rad: Any


@expression
def torque(p: P, i: int, flow: Flow) -> Quantity:
    """Return the pull of the cable about the hinge: N m."""
    loose = np.minimum(np.maximum(flow.pitch_rad, -p.slack_rad), p.slack_rad)
    return -p.stiffness_Nm_per_rad * (flow.pitch_rad - loose)


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the stiffness that matters, in the measure of m g L: N m/rad."""
    return {"stiffness_Nm_per_rad": 0.02 * torque_scale(rig)}


EFFECT = Effect(
    name="cable",
    title="Cable",
    description="A cable hangs slack about level and pulls once the slack is used up.",
    subsystem="hinge",
    order=60,
    law="torque = -k (pitch - pitch within +-slack)",
    numbers=P,
    parameters=(
        number(
            "stiffness_Nm_per_rad",
            "N m/rad",
            0.0,
            "stiffness of the taut cable",
            neutral=0.0,
            within=(0.0, 20.0),
        ),
        number(
            "slack_rad",
            "rad",
            0.1,
            "angle up to which the cable hangs loose",
            within=(0.0, 1.5),
            source="assumed",
        ),
    ),
    hooks=Hooks(torque=torque),
    shows="large angles only",
    source="spring with a dead zone, an assumption",
    confused_with={"hinge_spring": "small angles separate them"},
    benches=frozenset(),
    always_compiled=True,
    acts_in_flight=False,
    tolerance_of=tolerance_of,
)
