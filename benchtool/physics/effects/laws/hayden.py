"""Hayden 1976: a curve through flight tests of helicopters."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.effects.laws import law


@law.expression
def denominator(p: Any, i: int, flow: law.Flow) -> law.Quantity:
    """Return s (1 - 1/G), G = max(1, (0.9926 + 0.03794 (2R/z)^2)^(2/3))."""
    x = law.z_over_R(i, flow)
    power = np.maximum(0.9926 + 0.15176 / (x * x), 1.0)
    return p.strength * law.term_of(power ** (2.0 / 3.0))


EFFECT = law.law_effect(
    name="hayden",
    title="Hayden 1976",
    proper_noun=True,
    description=(
        "A curve through flight tests of full-size helicopters, as power out of over power in "
        "ground effect at equal thrust. As printed it falls below 1 beyond z/R 4.528; it is "
        "clipped to 1 there. That the power is the induced share is unverified."
    ),
    formula="max(1, 0.9926 + 0.03794 (2R/z)^2)^(2/3)",
    parameters=(
        law.amplitude(
            "strength", 1.0, "share of the term 1 - 1/G that acts", "1: as published", 5.0
        ),
    ),
    denominator=denominator,
    source="Hayden 1976, as in public code",
    distance_law=law.DistanceLaw(
        basis="equal induced power",
        far="1: clipped beyond z/R 4.528, where the printed curve falls below 1, to 0.9951",
        tested="z/R 0.5 to 4.5, full-size helicopters",
        seen=(
            "aurelappius/offboard app_quad_control/src/compensators.cpp; the share of induced "
            "power is from memory, unverified"
        ),
        singular=lambda p: 0.0,
    ),
)
