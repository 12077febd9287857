"""Recirculation of the outwash through the rotors in a room."""

from __future__ import annotations

import numpy as np

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number


def factor(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return 1 - s a (x/c) exp(1 - x/c), x = z/R: a loss that is largest at c radii."""
    x = flow.height_m[i] / (flow.radius_m * p.height)
    return 1.0 - p.share * flow.coverage[i] * x * np.exp(1.0 - x)


EFFECT = Effect(
    name="recirculation",
    title="Recirculation in a room",
    description=(
        "The outwash over a surface rises at nearby walls and re-enters the rotors, which lose "
        "thrust at medium distances. The formula is assumed and passes through one measured "
        "point; s depends on the distance of the walls."
    ),
    subsystem="rpm_to_thrust",
    order=75,
    law="factor 1 - s a (z/cR) exp(1 - z/cR), a the covered fraction of the disc",
    parameters=(
        number(
            "share", "1", 0.0, "maximum relative loss s of thrust", neutral=0.0,
            within=(0.0, 0.5), tolerance=0.01,  # recirculation never increases thrust
        ),
        number(
            "height", "1", 2.5, "z/R of the maximum loss c", within=(0.5, 10.0),
            source="2.5: z/R at which the source states a loss of 7 %",
        ),
    ),
    hooks=Hooks(factor=factor),
    shows="z/R of 1 to 6 near walls; less thrust than out of ground effect",
    source=(
        "Thrust variations in small rotors due to corner and vertex effects on the ground side, "
        "The Aeronautical Journal, 2025 (abstract): 93 % at z/R 2.5, 1.5 R from two walls; "
        "formula assumed"
    ),
    confused_with={"wall_blockage": "distances beyond z/R 4 separate them"},
    benches=frozenset(),
)  # fmt: skip
