"""A ceiling over the rotors, like eq. (2) with a distance added."""

from __future__ import annotations

from typing import Any

from benchtool.physics.effects.laws import law


@law.expression
def denominator(p: Any, i: int, flow: law.Flow) -> law.Quantity:
    """Return g (R/(z + a2))^2, z to the ceiling."""
    x = law.z_over_R(i, flow) + p.a2_over_R
    return p.g / (x * x)


FROM_MEMORY = "from memory, unverified: a1 6.924, a2 0.0378 m for R 0.12 m; free"

EFFECT = law.law_effect(
    name="ceiling",
    title="Ceiling",
    description=(
        "A surface above draws a rotor on, like eq. (2) with its own strength and a length added "
        "to the distance. Formula and constants are from memory, unverified: both are free."
    ),
    formula="1/(1 - g (R/(z + a2))^2), g = 1/a1, z to the ceiling",
    parameters=(
        law.unverified(law.amplitude("g", 0.1444, "strength g = 1/a1", FROM_MEMORY, 5.0)),
        law.unverified(
            law.number(
                "a2_over_R", "1", 0.315, "length a2 over R", within=(1e-3, 5.0), source=FROM_MEMORY
            )
        ),
    ),
    denominator=denominator,
    source="unverified: Sanchez-Cuevas et al. 2017 on ceilings, from memory",
    distance_law=law.DistanceLaw(
        basis="not stated",
        tested="not known",
        seen="nothing",
        singular=lambda p: max(0.0, p["g"] ** 0.5 - p["a2_over_R"]),
        compared=("g", "a2_over_R"),
        surface="above",
    ),
    acts_in_flight=False,
)
