"""Thrust loss of neighbouring rotors out of ground effect."""

from __future__ import annotations

import numpy as np

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number


def factor(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return 1 - s sum over running rotors j != i of exp(-(d_ij/2R - 1)/l)."""
    loss = 0.0
    for j in range(len(flow.height_m)):
        dx = flow.position_x_m[j] - flow.position_x_m[i]
        dy = flow.position_y_m[j] - flow.position_y_m[i]
        clearance = np.sqrt(dx * dx + dy * dy) / (2.0 * flow.radius_m) - 1.0
        loss = loss + (1.0 * (j != i)) * flow.active[j] * np.exp(-clearance / p.reach)
    return 1.0 - p.share * loss


EFFECT = Effect(
    name="rotor_interaction",
    description=(
        "Rotors with small tip clearance lose a few per cent of thrust, also out of ground effect. "
        "The formula is assumed. To measure it, compare one running rotor with all of them out of "
        "ground effect; with all rotors on, it only scales k."
    ),
    subsystem="rpm_to_thrust",
    order=65,
    law="factor 1 - s sum_{j != i} exp(-(d_ij/2R - 1)/l), j over running rotors",
    parameters=(
        number(
            "share", "1", 0.0, "relative thrust loss s per neighbour at zero tip clearance",
            neutral=0.0, within=(0.0, 0.2), tolerance=0.01,  # tip vortices never increase thrust
        ),
        number(
            "reach", "1", 0.3, "decay length l of the loss over 2R", within=(0.05, 3.0),
            source="assumed",
        ),
    ),
    hooks=Hooks(factor=factor),
    shows="one rotor compared with several, out of ground effect",
    source=(
        "formula assumed; slight thrust loss of close rotors: simulations in Energies 13 (2020) "
        "5995, measurements of Zhou as in byuflowlab/FLOWUnsteady discussion 118"
    ),
    confused_with={"wall_blockage": "one running rotor compared with all of them separates them"},
    benches=frozenset(),
)  # fmt: skip
