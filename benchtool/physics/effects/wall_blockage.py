"""Download of the rotor wake on the test stand, reduced near the plate."""

from __future__ import annotations

import numpy as np

from benchtool.core.parameter import Prior
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number

RECOVERY = 1.22  # Leishman 2006, eq. (6.36): download ratio 1 - 1.22 exp(-z/R)


def factor(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return the share of a disc's thrust that remains after the download."""
    falloff = np.exp(-flow.height_m[i] / (p.reach * flow.radius_m))
    return 1.0 - p.share * (1.0 - flow.coverage[i] * RECOVERY * falloff)


EFFECT = Effect(
    name="wall_blockage",
    title="Stand in the wake",
    description=(
        "The wake exerts a download on a test stand, frame or wall, also out of ground effect. A "
        "near plate slows the wake, so part of the thrust recovers."
    ),
    subsystem="rpm_to_thrust",
    order=70,
    law="factor 1 - b (1 - a 1.22 exp(-z/(c R))), a the covered fraction of the disc",
    parameters=(
        number(
            "share", "1", 0.0, "download b over thrust, out of ground effect", neutral=0.0,
            within=(0.0, 0.5), tolerance=0.01,  # a download is never negative
        ),
        number(
            "reach", "1", 1.0, "decay length c of the recovery over R",
            within=(0.5, 2.0), source="1: Leishman 2006, eq. (6.36)",
            prior=Prior("normal", 1.0, 0.05, "assumed: curve read from a figure, accurate to 5 %"),
        ),
    ),
    hooks=Hooks(factor=factor),
    shows="z/R of 0.5 to 4 compared with larger ones; the latter alone only scale k",
    source=(
        "Leishman 2006, eq. (6.36), after Fradenburgh 1972: recovery of a fuselage's download, "
        "z/R above 0.25; assumed for a test stand at rotor height"
    ),
    confused_with={
        "body_lift": "several distances from z/R 0.5 to beyond 5 separate them",
        "plate_offset": "distances beyond z/R 2 separate them",
    },
    benches=frozenset({"sweep"}),
)  # fmt: skip
