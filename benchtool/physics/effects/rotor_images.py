"""Image source of each rotor: ground effect of a single rotor, eq. (2)."""

from __future__ import annotations

from benchtool.physics.distance_law import DistanceLaw
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.images import self_image


def denominator(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return (R / 4 z_i)^2 of eq. (2)."""
    return p.own_strength * flow.radius_m * flow.radius_m * self_image(flow.height_m[i])


EFFECT = Effect(
    name="rotor_images",
    title="Rotors' own images",
    description="The image source of a rotor below the plate reduces its inflow: eq. (2).",
    subsystem="rpm_to_thrust",
    order=40,
    law="denominator - s (R/4z)^2",
    parameters=(
        number(
            "own_strength", "1", 1.0, "strength s of the own image; 1 is eq. (2)", neutral=0.0,
            within=(0.0, 5.0), tolerance=0.05, source="Sanchez-Cuevas et al. 2017, eq. (2)",
        ),
    ),
    hooks=Hooks(denominator=denominator),
    shows="every rotor over the plate, z/R below 2",
    source="Sanchez-Cuevas et al. 2017, eq. (2); method of images (Cheeseman and Bennett 1955)",
    confused_with={"ground_shape": "distances above and below z/R 1 separate them"},
    benches=frozenset(),
    always_compiled=True,
    distance_law=DistanceLaw(
        basis="equal induced power",
        tested="z/R from 0.5; single rotors of 0.12 and 0.205 m, a quadrotor of 0.12 m",
        seen="the paper",
        singular=lambda p: 0.25 * p["own_strength"] ** 0.5, compared=("own_strength",),
    ),
)  # fmt: skip
