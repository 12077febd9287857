"""The plate is not parallel to the rotor plane."""

from __future__ import annotations

from typing import Any

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number


@expression
def tilt(p: Any, i: int, flow: Flow) -> Quantity:
    """Return the lean beyond what was commanded, about the same pivot: the plate's centre."""
    return p.angle_rad


EFFECT = Effect(
    name="plate_tilt",
    title="Plate tilt",
    description=(
        "The plate leans by a small angle about the y axis that nobody noticed. Like a commanded "
        "tilt it turns about the plate's centre, whose distance along the rotor axis is read."
    ),
    subsystem="plate",
    order=20,
    law="z_i = z cos(a) - (x_i - x_plate) sin(a), a with the commanded tilt",
    parameters=(
        number(
            "angle_rad", "rad", 0.0, "tilt beyond what was commanded", neutral=0.0,
            within=(-0.3, 0.3), tolerance=0.01,
        ),
    ),
    hooks=Hooks(tilt=tilt),
    shows="near distances, rotors away from the plate's centre",
    source="geometry",
    confused_with={"plate_offset": "lateral plate positions separate them"},
    benches=frozenset({"sweep"}),
    acts_in_flight=False,
)  # fmt: skip
