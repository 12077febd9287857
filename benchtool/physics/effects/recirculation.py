"""Recirculation: in a room the outwash comes back down through the rotors."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number


@expression
def factor(p: Any, i: int, flow: Flow) -> Quantity:
    """Return 1 - s a (x/c) exp(1 - x/c), x = z/R: a loss that is largest at c radii."""
    x = flow.height_m[i] / (flow.radius_m * p.height)
    return 1.0 - p.share * flow.coverage[i] * x * np.exp(1.0 - x)


EFFECT = Effect(
    name="recirculation",
    title="Recirculation in a room",
    description=(
        "Where walls stand around a surface below, the outwash rises along them and comes back "
        "into the rotors, which lose thrust at middle distances. The form is a guess through one "
        "measured point; the distance of the walls is in its share."
    ),
    subsystem="rpm_to_thrust",
    order=75,
    law="factor 1 - s a (z/cR) exp(1 - z/cR), a the covered fraction of the disc",
    parameters=(
        number(
            "share",
            "1",
            0.0,
            "largest share s of the thrust that is lost",
            neutral=0.0,
            within=(0.0, 0.5),  # air that comes back down only ever takes
            tolerance=0.01,
        ),
        number(
            "height", "1", 2.5, "z/R at which most is lost", within=(0.5, 10.0),
            source="2.5: where the source states its 7 %",
        ),
    ),
    hooks=Hooks(factor=factor),
    shows="z/R of 1 to 6 with walls near; less thrust than far from the surface",
    source=(
        "Thrust variations in small rotors due to corner and vertex effects on the ground side, "
        "The Aeronautical Journal, 2025 (abstract): 93 % at z/R 2.5, 1.5 R from two walls; the "
        "form is a guess"
    ),
    confused_with={"wall_blockage": "distances beyond z/R 4 separate them"},
    benches=frozenset(),
)  # fmt: skip
