"""Unequal thrust coefficients on the two sides of the hinge."""

from __future__ import annotations

import numpy as np

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.expression import at_least


def factor(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return the ratio for discs opposite the first disc, 1 for the others."""
    side = flow.position_x_m[i] * flow.position_x_m[0]
    opposite = at_least(-np.sign(side), 0.0)
    return 1.0 + opposite * (p.ratio - 1.0)


EFFECT = Effect(
    name="rotor_asymmetry",
    description="Rotors on the two sides of the hinge produce different thrust at equal speed.",
    subsystem="rpm_to_thrust",
    order=80,
    law="thrust of the rotors opposite the first one is multiplied by the ratio",
    parameters=(
        number(
            "ratio", "1", 1.0,
            "thrust on the side opposite the first rotor over thrust on its side", neutral=1.0,
            within=(0.1, 3.0), tolerance=0.015,
        ),
    ),
    hooks=Hooks(factor=factor),
    shows="always; a constant torque, proportional to the collective",
    source="worn or unequal propellers",
    confused_with={"cog_offset": "collective steps of 10 % separate them"},
    benches=frozenset({"pitch"}),
    always_compiled=True,
)  # fmt: skip
