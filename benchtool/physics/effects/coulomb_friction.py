"""Coulomb friction of the hinge: static and sliding."""

from __future__ import annotations

from benchtool.core.parameter import Prior
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.rig_scaling import scale_rig, torque_scale


def dry_friction(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return the maximum friction torque of the hinge: N m."""
    return p.torque_Nm


def dry_width(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return the rate at which friction reaches its full torque: rad/s."""
    return p.width_rad_s


def dry_give(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return the presliding displacement of the hinge: rad."""
    return p.give_rad


EFFECT = Effect(
    name="coulomb_friction",
    proper_noun=True,
    description="The hinge resists torques up to T at rest and opposes motion with T.",
    subsystem="hinge",
    order=10,
    law="torque = -T sign(rate); at rest, the opposite of the applied torque up to T",
    parameters=(
        number(
            "torque_Nm", "N m", 0.0, "dry friction torque of the hinge", neutral=0.0,
            within=(0.0, 10.0),
        ),
        number(
            "width_rad_s", "rad/s", 0.0,
            "rate of full friction torque; 0 for stiction (Coulomb's law)", within=(0.0, 1.0),
            prior=Prior("normal", 0.0, 0.03, "assumed: bearings creep below 2 deg/s"),
            source="Coulomb's law",
        ),
        number(
            "give_rad", "rad", 0.0,
            "presliding displacement; 0 for stiction (Coulomb's law)",
            within=(0.0, 0.1),
            prior=Prior("normal", 0.0, 0.002, "assumed: bearings slip within half a degree"),
            source="Coulomb's law",
        ),
    ),
    hooks=Hooks(dry_friction=dry_friction, dry_width=dry_width, dry_give=dry_give),
    shows="slow reversals; the beam sticks short of its reference",
    source="Coulomb's law with stiction",
    confused_with={
        "viscous_friction": "fast and slow motion separate them",
        "stribeck": "speeds near zero separate them",
    },
    law_error=0.05,  # presliding displacement; assumed, textbooks give more
    benches=frozenset({"pitch"}),
    always_compiled=True,
    acts_in_flight=False,
    tolerance_of=scale_rig(torque_scale, torque_Nm=0.002),
)  # fmt: skip
