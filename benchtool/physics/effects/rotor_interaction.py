"""Rotors beside each other take each other's air, with no surface near."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number


@expression
def factor(p: Any, i: int, flow: Flow) -> Quantity:
    """Return 1 - s sum over j != i that turn of exp(-(d_ij/2R - 1)/l)."""
    lost = 0.0
    for j in range(len(flow.height_m)):
        dx = flow.position_x_m[j] - flow.position_x_m[i]
        dy = flow.position_y_m[j] - flow.position_y_m[i]
        apart = np.sqrt(dx * dx + dy * dy) / (2.0 * flow.radius_m) - 1.0
        lost = lost + (1.0 * (j != i)) * flow.active[j] * np.exp(-apart / p.reach)
    return 1.0 - p.share * lost


EFFECT = Effect(
    name="rotor_interaction",
    title="Rotors beside each other",
    description=(
        "Out of ground effect too, rotors with small tip clearance lose a few per cent of their "
        "thrust to each other. Form and reach are a guess; compare one rotor with all of them far "
        "from every surface. With all rotors on, it only scales k."
    ),
    subsystem="rpm_to_thrust",
    order=65,
    law="factor 1 - s sum_{j != i} exp(-(d_ij/2R - 1)/l), j the rotors that turn",
    parameters=(
        number(
            "share",
            "1",
            0.0,
            "share s of the thrust that a neighbour takes with its tips touching",
            neutral=0.0,
            within=(0.0, 0.2),  # tip vortices of a neighbour only ever take
            tolerance=0.01,
        ),
        number(
            "reach", "1", 0.3, "tip clearance l over 2R in which it falls off", within=(0.05, 3.0),
            source="a guess",
        ),
    ),
    hooks=Hooks(factor=factor),
    shows="one rotor against several, far from every surface",
    source=(
        "a guess; that thrust drops slightly as rotors come close: simulations in Energies 13 "
        "(2020) 5995, measurements of Zhou as in byuflowlab/FLOWUnsteady discussion 118"
    ),
    confused_with={"wall_blockage": "one rotor alone against all of them separates them"},
    benches=frozenset(),
)  # fmt: skip
