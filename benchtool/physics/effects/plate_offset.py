"""The plate stands elsewhere than its reading says."""

from __future__ import annotations

from collections.abc import Mapping

from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import BenchKind, Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression
from benchtool.physics.size import radius_scale


@expression
def height(i: int, flow: Flow, p: Values) -> Quantity:
    """Return the distance to add to what was read: true minus read."""
    return p[0]


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the offset that matters, in the measure of the rotor radius: m."""
    return {"dz_m": 0.003 * radius_scale(rig)}


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
    benches=frozenset({"pitch", "sweep"}),
    separated_by={
        "R_m": "plate distances both near (z/R 0.5) and above z/R = 1",
        "body_lift.K_b": "three or more plate distances",
    },
    trends_over=("z_over_R",),
    tolerance_of=tolerance_of,
    height=height,
)
