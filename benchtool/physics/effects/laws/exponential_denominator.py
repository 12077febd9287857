"""An exponential in the denominator of the thrust ratio."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.effects.laws.law import (
    NEAR_EQ_2,
    DistanceLaw,
    Flow,
    Quantity,
    amplitude,
    decay,
    expression,
    law_effect,
    unverified,
    z_over_R,
)


@expression
def denominator(p: Any, i: int, flow: Flow) -> Quantity:
    """Return Ca exp(-Cb z/R)."""
    return p.Ca * np.exp(-p.Cb * z_over_R(i, flow))


EFFECT = law_effect(
    name="exponential_denominator",
    title="Exponential in the denominator",
    description=(
        "The inflow falls exponentially toward the plate at equal T v. No source was seen that "
        "prints it: it carries no name, and both constants are free."
    ),
    formula="1/(1 - Ca exp(-Cb z/R)), Ca < 1",
    parameters=(
        unverified(amplitude("Ca", 0.9, "share of the inflow lost at contact", NEAR_EQ_2, 0.999)),
        unverified(decay(2.6, NEAR_EQ_2)),
    ),
    denominator=denominator,
    source="unverified: from memory, no source seen",
    distance_law=DistanceLaw(
        basis="equal induced power",
        tested="not known",
        seen="nothing; the bound Ca < 1, which keeps it finite at contact, is ours",
        compared=("Ca", "Cb"),
    ),
)
