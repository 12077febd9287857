"""Dry friction of the hinge: it sticks, and it drags."""

from __future__ import annotations

from benchtool.aero.expression import expression
from benchtool.core.parameter import Parameter
from benchtool.effects.effect import Effect, Flow, Quantity, Values


@expression
def dry_friction(flow: Flow, p: Values) -> Quantity:
    """Return the torque that the hinge can hold: N m."""
    return p[0]


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
            tolerance=0.002,
            description="dry friction torque of the hinge",
            source="neutral value",
        ),
    ),
    shows="slow reversals; the beam sticks short of its reference",
    source="Coulomb's law with real stick",
    confused_with={
        "viscous_friction": "fast and slow motion separate them",
        "stribeck": "speeds near zero separate them",
    },
    dry_friction=dry_friction,
)
