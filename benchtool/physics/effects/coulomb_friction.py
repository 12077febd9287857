"""Dry friction of the hinge: it sticks, and it drags."""

from __future__ import annotations

from typing import Any

from benchtool.core.parameter import Prior
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number
from benchtool.physics.rig_scaling import scale_rig, torque_scale


@expression
def dry_friction(p: Any, i: int, flow: Flow) -> Quantity:
    """Return the torque that the hinge can hold: N m."""
    return p.torque_Nm


@expression
def dry_width(p: Any, i: int, flow: Flow) -> Quantity:
    """Return the rate over which the friction builds up: rad/s."""
    return p.width_rad_s


@expression
def dry_give(p: Any, i: int, flow: Flow) -> Quantity:
    """Return the angle by which the hinge yields before it slips: rad."""
    return p.give_rad


EFFECT = Effect(
    name="coulomb_friction",
    title="Coulomb friction",
    proper_noun=True,
    description="The hinge holds up to a torque at rest and opposes motion with the same torque.",
    subsystem="hinge",
    order=10,
    law="torque = -T sign(rate); at rest it holds whatever is below T",
    parameters=(
        number(
            "torque_Nm", "N m", 0.0, "dry friction torque of the hinge", neutral=0.0,
            within=(0.0, 10.0),
        ),
        number(
            "width_rad_s", "rad/s", 0.0,
            "rate over which it builds up; 0 is Coulomb's law with real stick", within=(0.0, 1.0),
            prior=Prior("normal", 0.0, 0.03, "assumed: bearings creep below 2 deg/s"),
            source="Coulomb's law",
        ),
        number(
            "give_rad", "rad", 0.0,
            "angle by which it yields before it slips; 0 is Coulomb's law with real stick",
            within=(0.0, 0.1),
            prior=Prior("normal", 0.0, 0.002, "assumed: bearings slip within half a degree"),
            source="Coulomb's law",
        ),
    ),
    hooks=Hooks(dry_friction=dry_friction, dry_width=dry_width, dry_give=dry_give),
    shows="slow reversals; the beam sticks short of its reference",
    source="Coulomb's law with real stick",
    confused_with={
        "viscous_friction": "fast and slow motion separate them",
        "stribeck": "speeds near zero separate them",
    },
    law_error=0.05,  # a hinge gives way a little before it slips; a guess, textbooks give more
    benches=frozenset({"pitch"}),
    always_compiled=True,
    acts_in_flight=False,
    tolerance_of=scale_rig(torque_scale, torque_Nm=0.002),
)  # fmt: skip
