"""Lateral offset of the plate from its reading."""

from __future__ import annotations

import numpy as np

from benchtool.core.parameter import Prior
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number

CHORD_POWER = 0.35  # sine of a chord's half angle is (4 a (1 - a))^0.35 within 0.03; fitted


def coverage(p: Numbers, i: int, flow: Flow, fraction: Quantity) -> Quantity:
    """Return the coverage after the edge moved by dx: da = 2 sin(phi) / (pi R) dx."""
    product = np.maximum(fraction * (1.0 - fraction), 0.0)
    chord = 2.0 * (4.0 * product) ** CHORD_POWER / (np.pi * p.disc_radius_m)
    outward = np.sign(flow.position_x_m[i] - flow.plate_x_m)
    return np.minimum(np.maximum(fraction + p.dx_m * outward * chord, 0.0), 1.0)


EFFECT = Effect(
    name="plate_side",
    title="Plate's lateral offset",
    description=(
        "A zero error of the plate's lateral position changes the coverage of discs at its edge. "
        "Every explanation adjusts it within its prior."
    ),
    subsystem="plate",
    order=30,
    law="a = a_nominal +- 2 sin(phi) dx / (pi R) at an edge, phi the half angle of its chord",
    parameters=(
        number(
            "dx_m", "m", 0.0, "true minus read lateral position", neutral=0.0, within=(-0.02, 0.02),
            prior=Prior("normal", 0.0, 0.0015, "assumed: the plate's side is set with a ruler"),
            tolerance=0.0015,
        ),
        number(
            "disc_radius_m", "m", 0.12,
            "radius of the discs cut by the edge: geometric, not R_m", within=(1e-3, 10.0),
            source="convention: 24 cm propeller",
        ),
    ),
    hooks=Hooks(coverage=coverage),
    shows="plate edges under a disc, from both sides",
    source="geometry of a circle and a straight edge; magnitude assumed",
    confused_with={"partial_coverage": "edges on both sides separate them"},
    benches=frozenset(),
    adjusted_on=frozenset({"sweep"}),
    acts_in_flight=False,
    rig_values=lambda rig: {"disc_radius_m": rig.propulsion.radius_m},
)  # fmt: skip
