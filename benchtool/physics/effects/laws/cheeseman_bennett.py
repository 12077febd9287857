"""Cheeseman and Bennett 1955 with an effective radius of its own."""

from __future__ import annotations

from typing import Any

from benchtool.physics.effects.laws import law


@law.expression
def denominator(p: Any, i: int, flow: law.Flow) -> law.Quantity:
    """Return (R_e/4z)^2."""
    return law.own_image(i, flow, p.R_e_over_R)


EFFECT = law.law_effect(
    name="cheeseman_bennett",
    title="Cheeseman and Bennett 1955",
    proper_noun=True,
    description=(
        "Eq. (2) with an effective radius R_e in the rotor's own image alone; the images of "
        "neighbours and body keep R."
    ),
    formula="1/(1 - (R_e/4z)^2)",
    parameters=(
        law.amplitude("R_e_over_R", 1.0, "effective over rotor radius", "1: as published", 3.0),
    ),
    denominator=denominator,
    source="Cheeseman and Bennett 1955, ARC R&M 3021; Sanchez-Cuevas et al. 2017, eq. (2)",
    distance_law=law.DistanceLaw(
        basis="equal induced power",
        tested="z/R 0.5 to 2, helicopters and single rotors",
        seen=(
            "eq. (2) of the paper; Synetic-Labs/SkyFlow-Dynamics spec/ground_effect.py; "
            "TAARG-Education/F2Rotor GroundEffect.py (which takes the power ratio at equal thrust "
            "as 1/G; it is G^(-3/2))"
        ),
        singular=lambda p: 0.25 * p["R_e_over_R"],
        compared=("R_e_over_R",),
        same_as="rotor_images",
    ),
)
