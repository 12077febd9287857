"""An exponential in the denominator of the thrust ratio."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.effects.laws import law


@law.expression
def denominator(p: Any, i: int, flow: law.Flow) -> law.Quantity:
    """Return Ca exp(-Cb z/R)."""
    return p.Ca * np.exp(-p.Cb * law.z_over_R(i, flow))


EFFECT = law.law_effect(
    name="exponential_denominator",
    title="Exponential in the denominator",
    description=(
        "The inflow falls exponentially toward the plate at equal T v. No source was seen that "
        "prints it: it carries no name, and both constants are free."
    ),
    formula="1/(1 - Ca exp(-Cb z/R)), Ca < 1",
    parameters=(
        law.unverified(
            law.amplitude("Ca", 0.9, "share of the inflow lost at contact", law.NEAR_EQ_2, 0.999)
        ),
        law.unverified(law.decay(2.6, law.NEAR_EQ_2)),
    ),
    denominator=denominator,
    source="unverified: from memory, no source seen",
    distance_law=law.DistanceLaw(
        basis="equal induced power",
        tested="not known",
        seen="nothing; the bound Ca < 1, which keeps it finite at contact, is ours",
        compared=("Ca", "Cb"),
    ),
)
