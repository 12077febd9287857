"""Dry friction of the hinge: it sticks, and it drags."""

from __future__ import annotations

from collections.abc import Mapping

from benchtool.core.parameter import Parameter, Prior
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import BenchKind, Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression
from benchtool.physics.size import torque_scale


@expression
def dry_friction(flow: Flow, p: Values) -> Quantity:
    """Return the torque that the hinge can hold: N m."""
    return p[0]


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the friction that matters, in the measure of m g L: N m."""
    return {"torque_Nm": 0.002 * torque_scale(rig)}


@expression
def dry_width(flow: Flow, p: Values) -> Quantity:
    """Return the rate over which the friction builds up: rad/s."""
    return p[1]


EFFECT = Effect(
    name="coulomb_friction",
    title="Coulomb friction",
    description="The hinge holds up to a torque at rest and opposes motion with the same torque.",
    stage="hinge",
    law="torque = -T sign(rate); at rest it holds whatever is below T",
    parameters=(
        Parameter(
            "torque_Nm",
            "N m",
            0.0,
            neutral=0.0,
            lower=0.0,
            upper=10.0,
            description="dry friction torque of the hinge",
            source="neutral value",
        ),
        Parameter(
            "width_rad_s",
            "rad/s",
            0.0,
            lower=0.0,
            upper=1.0,
            prior=Prior("normal", 0.0, 0.03, "assumed: bearings creep below 2 deg/s"),
            description="rate over which it builds up; 0 is Coulomb's law with real stick",
            source="Coulomb's law",
        ),
    ),
    shows="slow reversals; the beam sticks short of its reference",
    source="Coulomb's law with real stick",
    confused_with={
        "viscous_friction": "fast and slow motion separate them",
        "stribeck": "speeds near zero separate them",
    },
    benches=frozenset({"pitch"}),
    # A hinge gives way a little before it slips; textbooks give more than this guess.
    law_error=0.05,
    tolerance_of=tolerance_of,
    dry_friction=dry_friction,
    dry_width=dry_width,
)
