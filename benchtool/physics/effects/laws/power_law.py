"""A power of the distance."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.effects.laws import law


@law.expression
def denominator(p: Any, i: int, flow: law.Flow) -> law.Quantity:
    """Return 1 - 1/G, G = 1 + a (z/R)^-p."""
    return law.term_of(1.0 + p.a * np.exp(-p.p * np.log(law.z_over_R(i, flow))))


EFFECT = law.law_effect(
    name="power_law",
    title="Power law",
    description="An increment like a power of the distance, which is free. A form of ours.",
    formula="1 + a (z/R)^-p",
    parameters=(
        law.amplitude("a", 0.0625, "increment at z/R 1", "1/16: eq. (2) to first order"),
        law.number(
            "p", "1", 2.0, "exponent p", within=(0.25, 8.0), source="2: eq. (2) to first order"
        ),
    ),
    denominator=denominator,
    source="none found: ours",
    distance_law=law.DistanceLaw(
        basis="not stated",
        tested="nowhere",
        seen="p = 2 stands in Synetic-Labs/SkyFlow-Dynamics spec/ground_effect.py",
        singular=lambda p: 0.0,
        compared=("a", "p"),
    ),
)
