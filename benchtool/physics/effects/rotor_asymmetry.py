"""Unequal rotors: one side of the hinge pulls more than the other."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number


@expression
def factor(p: Any, i: int, flow: Flow) -> Quantity:
    """Return the ratio for a disc on the other side of the hinge than the first disc, else 1."""
    side = flow.position_x_m[i] * flow.position_x_m[0]
    opposite = np.maximum(-np.sign(side), 0.0)
    return 1.0 + opposite * (p.ratio - 1.0)


EFFECT = Effect(
    name="rotor_asymmetry",
    title="Rotor asymmetry",
    description="The rotors on the two sides of the hinge give different thrust at equal speed.",
    subsystem="rpm_to_thrust",
    order=80,
    law="thrust of the rotors opposite the first one is multiplied by the ratio",
    parameters=(
        number(
            "ratio", "1", 1.0,
            "thrust of rotor 2 over rotor 1 (of the side opposite the first rotor)", neutral=1.0,
            within=(0.1, 3.0), tolerance=0.015,
        ),
    ),
    hooks=Hooks(factor=factor),
    shows="always; a constant torque that scales with the collective",
    source="worn or unequal propellers; a plain ratio",
    confused_with={"cog_offset": "collective steps of 10 % separate them"},
    benches=frozenset({"pitch"}),
    always_compiled=True,
)  # fmt: skip
