"""The plate stands elsewhere than its reading says."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import (
    BenchKind,
    Effect,
    Flow,
    Hooks,
    Quantity,
    expression,
    number,
)
from benchtool.physics.size import radius_scale


class P(NamedTuple):
    dz_m: Any


@expression
def height(p: P, i: int, flow: Flow, height_m: Quantity) -> Quantity:
    """Return the true distance: what was read, plus true minus read."""
    return height_m + p.dz_m


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the offset that matters, in the measure of the rotor radius: m."""
    return {"dz_m": 0.003 * radius_scale(rig)}


EFFECT = Effect(
    name="plate_offset",
    title="Plate distance offset",
    description="The zero of the plate distance is off by a constant.",
    subsystem="plate",
    order=10,
    law="z = z_read + dz",
    numbers=P,
    parameters=(
        number("dz_m", "m", 0.0, "true minus read distance", neutral=0.0, within=(-0.03, 0.03)),
    ),
    hooks=Hooks(height=height),
    shows="near distances; the curve is shifted sideways",
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
    tolerance_of=tolerance_of,
)
