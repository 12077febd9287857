"""Shape error of the ground-effect law: second-order term beyond eq. (2)."""

from __future__ import annotations

from benchtool.core.parameter import Prior
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.images import self_image

CURVATURE_PRIOR = Prior(
    "normal", 0.0, 0.1, "assumed: the increment of eq. (2) is correct to 3 % at z/R = 0.5"
)


def denominator(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return c D^2 with D the term of the disc's own image: second order in 1/z^2."""
    term = flow.axial_share * flow.radius_m * flow.radius_m * self_image(flow.height_m[i])
    return p.curvature * term * term


EFFECT = Effect(
    name="ground_shape",
    title="Shape of the ground-effect law",
    description=(
        "Eq. (2) is for a source in ideal flow at equal power. The response of a propeller at a "
        "given speed differs slightly near the plate. Every explanation adjusts it within its "
        "prior."
    ),
    subsystem="rpm_to_thrust",
    order=10,
    law="denominator - c (R/4z)^4",
    parameters=(
        number(
            "curvature", "1", 0.0, "strength c of the second-order term", neutral=0.0,
            within=(-0.5, 0.5), prior=CURVATURE_PRIOR, tolerance=0.1,
        ),
    ),
    hooks=Hooks(denominator=denominator),
    shows="z/R below 1",
    source=(
        "momentum balances give (1 - D/p)^-p with p from 2/3 to infinity, a second-order term of "
        "-1/2 to 1/4; magnitude assumed"
    ),
    confused_with={"plate_offset": "distances beyond z/R 1 separate them"},
    benches=frozenset(),
    adjusted_on=frozenset({"sweep"}),
)  # fmt: skip
