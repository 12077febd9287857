"""The plate stands elsewhere than its reading says."""

from __future__ import annotations

from benchtool.aero.expression import expression
from benchtool.core.parameter import Parameter
from benchtool.effects.effect import Effect, Flow, Quantity, Values


@expression
def height(i: int, flow: Flow, p: Values) -> Quantity:
    """Return the distance to add to what was read: true minus read."""
    return p[0]


EFFECT = Effect(
    name="plate_offset",
    title="Plate distance offset",
    description="The zero of the plate distance is off by a constant.",
    stage="plate",
    law="z = z_read + dz",
    parameters=(
        Parameter(
            "dz_m",
            "m",
            0.0,
            neutral=0.0,
            lower=-0.03,
            upper=0.03,
            tolerance=0.003,
            description="true minus read distance",
            source="neutral value",
        ),
    ),
    shows="near distances; the curve is shifted sideways",
    source="geometry",
    confused_with={
        "body_lift": "three plate distances separate them",
        "plate_tilt": "lateral plate positions separate them",
    },
    height=height,
)
