"""A cable that pulls when the beam turns far."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import BenchKind, Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression
from benchtool.physics.size import torque_scale


@expression
def torque(flow: Flow, p: Values) -> Quantity:
    """Return the pull of the cable about the hinge: N m."""
    loose = np.minimum(np.maximum(flow.pitch_rad, -p[1]), p[1])
    return -p[0] * (flow.pitch_rad - loose)


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the stiffness that matters, in the measure of m g L: N m/rad."""
    return {"stiffness_Nm_per_rad": 0.02 * torque_scale(rig)}


EFFECT = Effect(
    name="cable",
    title="Cable",
    description="A cable hangs slack about level and pulls once the slack is used up.",
    stage="hinge",
    law="torque = -k (pitch - pitch within +-slack)",
    parameters=(
        Parameter(
            "stiffness_Nm_per_rad",
            "N m/rad",
            0.0,
            neutral=0.0,
            lower=0.0,
            upper=20.0,
            description="stiffness of the taut cable",
            source="neutral value",
        ),
        Parameter(
            "slack_rad",
            "rad",
            0.1,
            neutral=None,
            lower=0.0,
            upper=1.5,
            description="angle up to which the cable hangs loose",
            source="assumed",
        ),
    ),
    shows="large angles only",
    source="spring with a dead zone, an assumption",
    confused_with={"hinge_spring": "small angles separate them"},
    benches=frozenset(),
    tolerance_of=tolerance_of,
    torque=torque,
)
