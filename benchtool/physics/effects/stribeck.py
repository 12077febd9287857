"""Friction that is greater at rest than in motion."""

from __future__ import annotations

from collections.abc import Mapping

from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import BenchKind, Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression
from benchtool.physics.size import torque_scale


@expression
def dry_friction(flow: Flow, p: Values) -> Quantity:
    """Return what the hinge holds beyond its friction in motion: N m."""
    ratio = flow.rate_rad_s / p[1]
    return p[0] / (1.0 + ratio * ratio)


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the friction that matters, in the measure of m g L: N m."""
    return {"excess_Nm": 0.002 * torque_scale(rig)}


EFFECT = Effect(
    name="stribeck",
    title="Stribeck friction",
    description="Near standstill the hinge holds more than it drags with when it moves.",
    stage="hinge",
    law="dry friction + T / (1 + (rate / rate_s)^2)",
    parameters=(
        Parameter(
            "excess_Nm",
            "N m",
            0.0,
            neutral=0.0,
            lower=0.0,
            upper=10.0,
            description="friction at rest above that in motion",
            source="neutral value",
        ),
        Parameter(
            "rate_rad_s",
            "rad/s",
            0.05,
            neutral=None,
            lower=0.0001,
            upper=10.0,
            description="rate at which half of the excess is gone",
            source="assumed",
        ),
    ),
    shows="slow reversals: the beam breaks loose with a jerk",
    source="Hess and Soom 1990, J. Tribology 112: the form 1 / (1 + (v/v_s)^2)",
    confused_with={"coulomb_friction": "speeds near zero separate them"},
    benches=frozenset(),
    tolerance_of=tolerance_of,
    dry_friction=dry_friction,
)
