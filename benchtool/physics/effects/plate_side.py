"""The plate stands aside of where its lateral reading says."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchtool.core.parameter import Parameter, Prior
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression

KNOWN = Prior("normal", 0.0, 0.0015, "assumed: the plate's side is set with a ruler")

CHORD_POWER = 0.35
"""(4 a (1 - a))^0.35 is the sine of the half angle that a chord cuts off a disc with the share a of
its area, within 0.03; our own fit to the exact relation."""


@expression
def area(i: int, fraction: Quantity, flow: Flow, p: Values) -> Quantity:
    """Return the covered fraction after the edge moved by dx: da = 2 sin(phi) / (pi R) dx."""
    left = np.maximum(fraction * (1.0 - fraction), 0.0)
    chord = 2.0 * (4.0 * left) ** CHORD_POWER / (np.pi * p[1])
    outward = np.sign(flow.position_x_m[i] - flow.plate_x_m)
    return np.minimum(np.maximum(fraction + p[0] * outward * chord, 0.0), 1.0)


def rig_values(rig: Rig) -> Mapping[str, float]:
    """Return the rotor's own radius as that of the discs: m."""
    return {"disc_radius_m": rig.propulsion.radius_m}


EFFECT = Effect(
    name="plate_side",
    title="Plate's lateral offset",
    description=(
        "The zero of the plate's lateral position is off, so that discs at its edge are covered a "
        "little more or less than stated. An explanation takes it for something that the bench's "
        "owner knows only roughly."
    ),
    stage="plate",
    law="a = a_stated +- 2 sin(phi) dx / (pi R) at an edge, phi the half angle of its chord",
    parameters=(
        Parameter(
            "dx_m",
            "m",
            0.0,
            neutral=0.0,
            lower=-0.02,
            upper=0.02,
            prior=KNOWN,
            tolerance=0.0015,
            description="true minus read lateral position",
            source="neutral value",
        ),
        Parameter(
            "disc_radius_m",
            "m",
            0.12,
            lower=1e-3,
            upper=10.0,
            description="radius of the discs that the edge cuts: the rotor's own, not R_m",
            source="convention: a 24 cm propeller",
        ),
    ),
    shows="plate edges under a disc, from both sides",
    source="geometry of a circle and a straight edge; the size is a guess",
    confused_with={"partial_coverage": "edges on both sides separate them"},
    benches=frozenset(),
    rig_values=rig_values,
    adjusted_on=frozenset({"sweep"}),
    area=area,
)
