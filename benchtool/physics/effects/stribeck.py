"""Stribeck friction: breakaway torque above the sliding friction."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.expression import unless_zero
from benchtool.physics.rig_scaling import scale_rig, torque_scale


def dry_friction(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return the friction in addition to the Coulomb friction: N m."""
    ratio = flow.rate_rad_s / p.rate_rad_s
    return unless_zero(p.excess_Nm, p.excess_Nm / (1.0 + ratio * ratio))


EFFECT = Effect(
    name="stribeck",
    title="Stribeck friction",
    proper_noun=True,
    description="The friction of the hinge is higher near standstill than in motion.",
    subsystem="hinge",
    order=20,
    law="dry friction + T / (1 + (rate / rate_s)^2)",
    parameters=(
        number(
            "excess_Nm", "N m", 0.0, "friction at rest above that in motion", neutral=0.0,
            within=(0.0, 10.0),
        ),
        number(
            "rate_rad_s", "rad/s", 0.05, "rate at which the excess has halved",
            within=(0.0001, 10.0), source="assumed",
        ),
    ),
    hooks=Hooks(dry_friction=dry_friction),
    shows="slow reversals: the beam breaks loose with a jerk",
    source="Hess and Soom 1990, J. Tribology 112: the form 1 / (1 + (v/v_s)^2)",
    confused_with={"coulomb_friction": "speeds near zero separate them"},
    benches=frozenset(),
    always_compiled=True,
    acts_in_flight=False,
    tolerance_of=scale_rig(torque_scale, excess_Nm=0.002),
)  # fmt: skip
