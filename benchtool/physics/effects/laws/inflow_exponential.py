"""Talbot and Corliss 1977: induced velocity at equal thrust falls exponentially."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.effects.laws import law


@law.expression
def denominator(p: Any, i: int, flow: law.Flow) -> law.Quantity:
    """Return 1 - kappa^(2/3), kappa = 1 - Ca exp(-Cb z/R)."""
    kappa = 1.0 - p.Ca * np.exp(-p.Cb * law.z_over_R(i, flow))
    return 1.0 - kappa ** (2.0 / 3.0)


EFFECT = law.law_effect(
    name="inflow_exponential",
    title="Inflow exponential",
    description=(
        "Induced velocity at equal thrust is kappa = 1 - Ca exp(-Cb z/R) of its value far away; "
        "at equal induced power that makes the thrust ratio kappa^(-2/3), which is ours."
    ),
    formula="(1 - Ca exp(-Cb z/R))^(-2/3), Ca < 1",
    parameters=(
        law.amplitude("Ca", 0.95, "share of the inflow lost at contact", law.NEAR_EQ_2, 0.999),
        law.decay(2.1, law.NEAR_EQ_2),
    ),
    denominator=denominator,
    source="Talbot and Corliss 1977, NASA TM-73254, as in public code; T ratio: ours",
    distance_law=law.DistanceLaw(
        basis="equal induced power",
        tested="helicopters; range not seen",
        seen="the velocity ratio in Synetic-Labs/SkyFlow-Dynamics, not the report",
        compared=("Ca", "Cb"),
    ),
)
