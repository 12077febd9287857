"""Body lift in the upwash between the rotors (fountain effect): added term of eq. (4)."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.expression import unless_zero


def denominator(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return K_b w R^2 times the sum of eq. (4) at the body's centre, from `disc_thrust`.

    w is the weight from the wake rule (`physics.body_lift`): 1 if all rotors are covered.
    """
    weight = p.K_b * flow.body_weight
    return unless_zero(weight, weight * flow.radius_m * flow.radius_m * flow.body_images[i])


EFFECT = Effect(
    name="body_lift",
    headline="K_b",
    title="Body lift (fountain)",
    description=(
        "The wakes of neighbouring rotors meet below the body, turn upward and lift it (fountain "
        "effect)."
    ),
    subsystem="rpm_to_thrust",
    order=30,
    law="denominator - K_b w 2 R^2 z / (b^2 + 4 z^2)^(3/2) for a quadrotor",
    parameters=(
        number(
            "K_b", "1", 2.0, "body lift coefficient", neutral=0.0, within=(0.0, 20.0),
            tolerance=0.25, source="paper: 'close to 2' (eq. 4)",
        ),
    ),
    hooks=Hooks(denominator=denominator),
    shows="several rotors over the plate, z/R below 5",
    source="Sanchez-Cuevas et al. 2017, eq. (4); w for partial coverage is assumed",
    confused_with={
        "plate_offset": "three plate distances separate them",
        "neighbour_images": "distances below and above half the rotor spacing separate them",
    },
    separated_by={
        "R_m": "plate distances both below z/R = 1, where R rules, and from 2 to 5, where K_b does",
        "k": "reference points without the plate",
    },
    trends_over=("z_over_R",),
    always_compiled=True,
)  # fmt: skip
