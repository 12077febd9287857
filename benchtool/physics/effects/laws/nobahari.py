"""Nobahari et al. 2014: Cheeseman and Bennett with the radius of a whole quadrotor."""

from __future__ import annotations

from typing import Any

from benchtool.physics.effects.laws import law


@law.expression
def denominator(p: Any, i: int, flow: law.Flow) -> law.Quantity:
    """Return (R_e/4z)^2."""
    return law.own_image(i, flow, p.R_e_over_R)


EFFECT = law.law_effect(
    name="nobahari",
    title="Nobahari 2014",
    proper_noun=True,
    description=(
        "Cheeseman and Bennett with R_e = 2.5 R for a whole quadrotor: neighbours and body are in "
        "it, and belong in no other effect beside it."
    ),
    formula="1/(1 - (R_e/4z)^2), R_e = 2.5 R",
    parameters=(
        law.amplitude("R_e_over_R", 2.5, "effective over rotor radius", "2.5: as published", 5.0),
    ),
    denominator=denominator,
    source="Nobahari et al. 2014, as in public code",
    distance_law=law.DistanceLaw(
        basis="not stated",
        tested="a quadrotor; range not seen",
        seen="aurelappius/offboard app_quad_control/src/compensators.cpp",
        singular=lambda p: 0.25 * p["R_e_over_R"],
        compared=("R_e_over_R",),
        same_as="rotor_images",
        whole_vehicle=True,
    ),
)
