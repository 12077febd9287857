"""Images of the neighbouring rotors: what makes eq. (3) differ from eq. (2)."""

from __future__ import annotations

from benchtool.core.parameter import Parameter
from benchtool.physics.effects.effect import Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression


@expression
def denominator(i: int, flow: Flow, p: Values) -> Quantity:
    """Return R^2 sum over j != i of z_i / (2 (d_ij^2 + 4 z_i^2)^(3/2)) of eq. (3)."""
    return p[0] * flow.radius_m * flow.radius_m * flow.neighbour_images[i]


EFFECT = Effect(
    name="neighbour_images",
    title="Neighbouring rotors' images",
    description="Each rotor feels the image sources of its neighbours under the plate too.",
    stage="rpm_to_thrust",
    law="denominator - s sum_{j != i} (R^2/2) z_i / (d_ij^2 + 4 z_i^2)^(3/2)",
    parameters=(
        Parameter(
            "strength",
            "1",
            1.0,
            neutral=0.0,
            lower=0.0,
            upper=5.0,
            tolerance=0.2,
            description="strength s of the neighbours' images; 1 is eq. (3)",
            source="Sanchez-Cuevas et al. 2017, eq. (3)",
        ),
    ),
    shows="several rotors over the plate, z/R of 1 to 3",
    source="Sanchez-Cuevas et al. 2017, eq. (3); method of images",
    confused_with={"body_lift": "distances below and above half the rotor spacing separate them"},
    benches=frozenset({"sweep"}),
    separated_by={
        "R_m": "the same distances with one rotor alone",
        "body_lift.K_b": "plate distances below and above half the rotor spacing",
    },
    denominator=denominator,
)
