"""The stand in the wake: the slipstream pushes on what holds the rotors, less so near the plate."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.core.parameter import Prior
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number

RECOVERY = 1.22  # Leishman 2006, eq. (6.36): download ratio 1 - 1.22 exp(-z/R)

REACH_KNOWN = Prior("normal", 1.0, 0.05, "assumed: a curve read off a figure holds to 5 %")


@expression
def factor(p: Any, i: int, flow: Flow) -> Quantity:
    """Return what the wake's push on the stand leaves of a disc's thrust."""
    falloff = np.exp(-flow.height_m[i] / (p.reach * flow.radius_m))
    return 1.0 - p.share * (1.0 - flow.coverage[i] * RECOVERY * falloff)


EFFECT = Effect(
    name="wall_blockage",
    title="Stand in the wake",
    description=(
        "Stand, frame or wall in the wake take part of the thrust as download, out of ground "
        "effect too; a near plate slows the wake and gives some of it back."
    ),
    subsystem="rpm_to_thrust",
    order=70,
    law="factor 1 - b (1 - a 1.22 exp(-z/(c R))), a the covered fraction of the disc",
    parameters=(
        number(
            "share",
            "1",
            0.0,
            "share b of the thrust that the stand takes with no plate near",
            neutral=0.0,
            within=(0.0, 0.5),  # a stand only ever takes
            tolerance=0.01,
        ),
        number(
            "reach", "1", 1.0, "distance c over R in which the recovery falls off",
            within=(0.5, 2.0), prior=REACH_KNOWN, source="1: Leishman 2006, eq. (6.36)",
        ),
    ),
    hooks=Hooks(factor=factor),
    shows="plate distances z/R of 0.5 to 4 against far ones; far ones alone only scale k",
    source=(
        "Leishman 2006, eq. (6.36), after Fradenburgh 1972: recovery of a fuselage's download, "
        "z/R above 0.25; for a stand at the rotor's height it is an assumption"
    ),
    confused_with={
        "body_lift": "several distances from z/R 0.5 to beyond 5 separate them",
        "plate_offset": "distances beyond z/R 2 separate them",
    },
    benches=frozenset({"sweep"}),
)  # fmt: skip
