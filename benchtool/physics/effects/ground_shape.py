"""The ground-effect law is off in shape: how thrust answers to a near image, beyond eq. (2)."""

from __future__ import annotations

from typing import Any

from benchtool.core.parameter import Prior
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number
from benchtool.physics.images import self_image

KNOWN = Prior(
    "normal", 0.0, 0.1, "assumed: the increment of eq. (2) holds to 3 % of itself at z/R = 0.5"
)


@expression
def denominator(p: Any, i: int, flow: Flow) -> Quantity:
    """Return c D^2 with D the disc's own image: the term of second order in 1/z^2."""
    own = flow.axial_share * flow.radius_m * flow.radius_m * self_image(flow.height_m[i])
    return p.curvature * own * own


EFFECT = Effect(
    name="ground_shape",
    title="Shape of the ground-effect law",
    description=(
        "Eq. (2) holds at equal power and for a source in an ideal flow; a propeller at given "
        "speed answers to a near plate a little more or less than that. An explanation takes it "
        "for something that the bench's owner knows only roughly."
    ),
    subsystem="rpm_to_thrust",
    order=10,
    law="denominator - c (R/4z)^4",
    parameters=(
        number(
            "curvature", "1", 0.0, "strength c of the term of second order", neutral=0.0,
            within=(-0.5, 0.5), prior=KNOWN, tolerance=0.1,
        ),
    ),
    hooks=Hooks(denominator=denominator),
    shows="z/R below 1",
    source=(
        "momentum balances differ in the exponent p of (1 - D/p)^-p: 2/3 to infinity, which are "
        "terms of second order of -1/2 to 1/4; the size here is a guess"
    ),
    confused_with={"plate_offset": "distances beyond z/R 1 separate them"},
    benches=frozenset(),
    adjusted_on=frozenset({"sweep"}),
)  # fmt: skip
