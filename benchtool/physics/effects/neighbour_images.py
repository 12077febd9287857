"""Image sources of the neighbouring rotors: the difference between eq. (3) and eq. (2)."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number


def denominator(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return R^2 times the sum over j != i of eq. (3), computed in `disc_thrust`."""
    return p.strength * flow.radius_m * flow.radius_m * flow.neighbour_images[i]


EFFECT = Effect(
    name="neighbour_images",
    title="Neighbouring rotors' images",
    description="The image sources of neighbouring rotors reduce a rotor's inflow too.",
    subsystem="rpm_to_thrust",
    order=20,
    law="denominator - s sum_{j != i} (R^2/2) z_i / (d_ij^2 + 4 z_i^2)^(3/2)",
    parameters=(
        number(
            "strength", "1", 1.0, "strength s of the neighbours' images; 1 is eq. (3)", neutral=0.0,
            within=(0.0, 5.0), tolerance=0.2, source="Sanchez-Cuevas et al. 2017, eq. (3)",
        ),
    ),
    hooks=Hooks(denominator=denominator),
    shows="several rotors over the plate, z/R of 1 to 3",
    source="Sanchez-Cuevas et al. 2017, eq. (3); method of images",
    confused_with={"body_lift": "distances below and above half the rotor spacing separate them"},
    separated_by={
        "R_m": "the same distances with one rotor alone",
        "body_lift.K_b": "plate distances below and above half the rotor spacing",
    },
    benches=frozenset({"sweep"}),
    always_compiled=True,
)  # fmt: skip
