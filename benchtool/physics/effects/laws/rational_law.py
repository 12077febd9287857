"""A rational function of the distance, finite at contact."""

from __future__ import annotations

from typing import Any

from benchtool.physics.effects.laws import law


@law.expression
def denominator(p: Any, i: int, flow: law.Flow) -> law.Quantity:
    """Return 1 - 1/G, G = 1 + g2/((z/R)^2 + g1)."""
    x = law.z_over_R(i, flow)
    return law.term_of(1.0 + p.g2 / (x * x + p.g1))


EFFECT = law.law_effect(
    name="rational_law",
    title="Rational law",
    description=(
        "An increment like 1/z^2 far away that stays finite at contact. Public code prints the "
        "fraction alone as the effect's force; the 1 + before it is ours, unverified."
    ),
    formula="1 + g2/((z/R)^2 + g1)",
    parameters=(
        law.unverified(law.amplitude("g2", 0.1, "strength g2, in R^2", law.NEAR_EQ_2)),
        law.unverified(
            law.number(
                "g1",
                "1",
                0.05,
                "distance g1 within which it levels off, in R^2",
                within=(1e-3, 10.0),
                source=law.NEAR_EQ_2,
            )
        ),
    ),
    denominator=denominator,
    source="after Yang et al. 2025, arXiv:2506.19424, as in public code",
    distance_law=law.DistanceLaw(
        basis="not stated",
        tested="z near 0, multirotors",
        seen=(
            "Madhaniitm/Maddy---Flight-Controller-alt-and-pos-hold-with-experiments "
            "experiments/exp_A4_ground_effect.py, which prints g2/(h^2 + g1)"
        ),
        compared=("g2", "g1"),
    ),
)
