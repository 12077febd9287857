"""The plate is not parallel to the rotor plane."""

from __future__ import annotations

import numpy as np

from benchtool.core.parameter import Parameter
from benchtool.physics.effects.effect import Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression


@expression
def height(i: int, flow: Flow, p: Values) -> Quantity:
    """Return what tilt a takes off: the +x rotors come nearer for a positive one.

    A stage carries the plate's centre, so that the distance read is the one there.
    """
    upright = flow.height_m[i]
    ahead_m = flow.position_x_m[i] - flow.plate_x_m
    return upright * (np.cos(p[0]) - 1.0) - ahead_m * np.sin(p[0])


EFFECT = Effect(
    name="plate_tilt",
    title="Plate tilt",
    description="The plate leans by a small angle about the y axis that nobody noticed.",
    stage="plate",
    law="z_i = z cos(a) - (x_i - x_plate) sin(a)",
    parameters=(
        Parameter(
            "angle_rad",
            "rad",
            0.0,
            neutral=0.0,
            lower=-0.3,
            upper=0.3,
            tolerance=0.01,
            description="tilt beyond what was commanded",
            source="neutral value",
        ),
    ),
    shows="near distances, rotors away from the plate's centre",
    source="geometry",
    confused_with={"plate_offset": "lateral plate positions separate them"},
    benches=frozenset({"sweep"}),
    height=height,
)
