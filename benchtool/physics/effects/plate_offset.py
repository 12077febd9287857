"""Offset of the plate distance from its reading."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.rig_scaling import radius_scale, scale_rig


def height(p: Numbers, i: int, flow: Flow, height_m: Quantity) -> Quantity:
    """Return the true distance: m."""
    return height_m + p.dz_m


EFFECT = Effect(
    name="plate_offset",
    title="Plate distance offset",
    description="The plate distance has a constant zero error.",
    subsystem="plate",
    order=10,
    law="z = z_read + dz",
    parameters=(
        number("dz_m", "m", 0.0, "true minus read distance", neutral=0.0, within=(-0.03, 0.03)),
    ),
    hooks=Hooks(height=height),
    shows="small distances; the thrust curve is shifted along z",
    source="geometry",
    confused_with={
        "body_lift": "three plate distances separate them",
        "plate_tilt": "lateral plate positions separate them",
    },
    separated_by={
        "R_m": "plate distances both near (z/R 0.5) and above z/R = 1",
        "body_lift.K_b": "three or more plate distances",
    },
    trends_over=("z_over_R",),
    always_compiled=True,
    tolerance_of=scale_rig(radius_scale, dz_m=0.003),
)
