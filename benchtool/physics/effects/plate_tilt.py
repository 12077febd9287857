"""The plate is not parallel to the rotor plane."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number


@expression
def height(p: Any, i: int, flow: Flow, height_m: Quantity) -> Quantity:
    """Return the distance at a tilt: the +x rotors come nearer for a positive one.

    A stage carries the plate's centre, so that the distance read is the one there.
    """
    ahead_m = flow.position_x_m[i] - flow.plate_x_m
    return height_m + (height_m * (np.cos(p.angle_rad) - 1.0) - ahead_m * np.sin(p.angle_rad))


EFFECT = Effect(
    name="plate_tilt",
    title="Plate tilt",
    description="The plate leans by a small angle about the y axis that nobody noticed.",
    subsystem="plate",
    order=20,
    law="z_i = z cos(a) - (x_i - x_plate) sin(a)",
    parameters=(
        number(
            "angle_rad",
            "rad",
            0.0,
            "tilt beyond what was commanded",
            neutral=0.0,
            within=(-0.3, 0.3),
            tolerance=0.01,
        ),
    ),
    hooks=Hooks(height=height),
    shows="near distances, rotors away from the plate's centre",
    source="geometry",
    confused_with={"plate_offset": "lateral plate positions separate them"},
    benches=frozenset({"sweep"}),
    acts_in_flight=False,
)
