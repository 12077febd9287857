"""A ceiling over the rotors, by momentum theory."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.effects.laws import law


@law.expression
def denominator(p: Any, i: int, flow: law.Flow) -> law.Quantity:
    """Return s (1 - 1/G), G = (1 + sqrt(1 + (R/z)^2/8))/2, z to the ceiling."""
    x = law.z_over_R(i, flow)
    return p.strength * law.term_of(0.5 + 0.5 * np.sqrt(1.0 + 0.125 / (x * x)))


EFFECT = law.law_effect(
    name="ceiling_momentum",
    title="Ceiling by momentum theory",
    description=(
        "A surface above draws a rotor on: the air that reaches it comes in from the side. Neither "
        "neighbours nor the body have a term beside it."
    ),
    formula="(1 + sqrt(1 + R^2/(8 z^2)))/2, z to the ceiling",
    parameters=(
        law.amplitude("strength", 1.0, "share of the term 1 - 1/G that acts", "1: as found", 5.0),
    ),
    denominator=denominator,
    source="momentum theory, as in public code for a Crazyflie",
    distance_law=law.DistanceLaw(
        basis="not stated",
        tested="range not seen; 1.37 at z/R 0.25, 1.11 at 0.5",
        seen="XinLong-Li/cf-frimware-2022-12 src/modules/src/lxl_proximity_effects.c",
        singular=lambda p: 0.0,
        compared=("strength",),
        surface="above",
    ),
    acts_in_flight=False,
)
