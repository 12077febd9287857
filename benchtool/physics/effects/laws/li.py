"""Li et al. 2015: Cheeseman and Bennett with a factor for a quadrotor."""

from __future__ import annotations

from typing import Any

from benchtool.physics.effects.laws import law


@law.expression
def denominator(p: Any, i: int, flow: law.Flow) -> law.Quantity:
    """Return c (R/4z)^2."""
    return p.c * law.own_image(i, flow, 1.0)


EFFECT = law.law_effect(
    name="li",
    title="Li 2015",
    proper_noun=True,
    description=(
        "Commanded over produced thrust of a quadrotor, T_in/T_out = 1 - c (R/4z)^2: neighbours "
        "and body are in c. c = 8.6 (Li), 3.4 as fitted again by Kan et al. 2019."
    ),
    formula="1/(1 - c (R/4z)^2)",
    parameters=(law.amplitude("c", 8.6, "factor c of the own image", "8.6: Li et al. 2015", 25.0),),
    denominator=denominator,
    source="Li (Danjun) et al. 2015, 34th Chinese Control Conference, as in public code",
    distance_law=law.DistanceLaw(
        basis="equal commanded thrust",
        tested="quadrotors; range not seen",
        seen=(
            "Madhaniitm/Maddy---Flight-Controller-alt-and-pos-hold-with-experiments "
            "experiments/exp_A4_ground_effect.py (c = 3.4); 8.6 in a report that cites Kan"
        ),
        singular=lambda p: 0.25 * p["c"] ** 0.5,
        compared=("c",),
        same_as="rotor_images",
        whole_vehicle=True,
    ),
)
