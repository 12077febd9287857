"""Plate tilt against the rotor plane."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number


def tilt(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return the tilt in addition to the commanded one, about the plate's centre: rad."""
    return p.angle_rad


EFFECT = Effect(
    name="plate_tilt",
    description=(
        "An unknown tilt of the plate about the y axis. The pivot is the plate's centre, as for a "
        "commanded tilt."
    ),
    subsystem="plate",
    order=20,
    law="z_i = z cos(a) - (x_i - x_plate) sin(a), a including the commanded tilt",
    parameters=(
        number(
            "angle_rad", "rad", 0.0, "tilt in addition to the commanded one", neutral=0.0,
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
