"""An increment that falls off exponentially: the form that public simulators use."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.effects.laws import law


@law.expression
def denominator(p: Any, i: int, flow: law.Flow) -> law.Quantity:
    """Return 1 - 1/G, G = 1 + Ca exp(-Cb z/R)."""
    return law.term_of(1.0 + p.Ca * np.exp(-p.Cb * law.z_over_R(i, flow)))


EFFECT = law.law_effect(
    name="exponential_law",
    title="Exponential law",
    description="The increment of thrust falls off exponentially and is finite at contact.",
    formula="1 + Ca exp(-Cb z/R)",
    parameters=(
        law.amplitude("Ca", 1.7, "increment at contact", law.NEAR_EQ_2),
        law.decay(3.2, law.NEAR_EQ_2),
    ),
    denominator=denominator,
    source="public code that names He, Kou, Calaf, Leang 2019 (ASME J. Dyn. Sys. 141, 071013)",
    distance_law=law.DistanceLaw(
        basis="not stated",
        tested="multirotors; range not seen",
        seen=(
            "Madhaniitm/Maddy---Flight-Controller-alt-and-pos-hold-with-experiments "
            "experiments/exp_A4_ground_effect.py and two more public simulators"
        ),
        compared=("Ca", "Cb"),
    ),
)
