"""The load cell shows less on the way up than on the way down."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from benchtool.core.parameter import Parameter, Prior
from benchtool.core.rig import Rig
from benchtool.core.units import STANDARD_GRAVITY_M_S2
from benchtool.physics.effects.effect import BenchKind, Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression
from benchtool.physics.size import weight_scale

GROWTH_KNOWN = Prior("normal", 0.0, 0.15, "assumed: data sheets tell one width, at full load")


@expression
def thrust_reading(
    reading: Quantity, flow: Flow, states: Sequence[Quantity], p: Values
) -> Quantity:
    """Return the reading behind a play: low after a rise, against the direction of the tare: N."""
    width = p[0] * (1.0 + p[2] * (reading / p[3] - 1.0))
    return reading - width * (flow.load_direction - p[1])


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the force that matters (a guess), in the measure of the weight: N."""
    return {"half_width_N": 0.02 * weight_scale(rig)}


def rig_values(rig: Rig) -> Mapping[str, float]:
    """Return the weight as the load at which the half width holds: N."""
    return {"reference_N": STANDARD_GRAVITY_M_S2 * rig.body.mass_kg}


EFFECT = Effect(
    name="load_cell_hysteresis",
    title="Load-cell hysteresis",
    description=(
        "A load reads lower when it was approached from a smaller one than from a greater one; "
        "friction in the stand and the cell itself do it."
    ),
    stage="sensor",
    law=(
        "reading = thrust - h (1 + s (thrust/ref - 1)) (d - d_tare), d = +1 approached from below, "
        "-1 from above"
    ),
    parameters=(
        Parameter(
            "half_width_N",
            "N",
            0.0,
            neutral=0.0,
            lower=0.0,
            upper=5.0,
            description="half the difference between the way down and the way up at the reference",
            source="neutral value",
        ),
        Parameter(
            "tare_direction",
            "1",
            -1.0,
            lower=-1.0,
            upper=1.0,
            description="direction d of the load at the tare: -1 after thrust, 0 on a fresh cell",
            source="convention: a bench is tared after its motors have run",
        ),
        Parameter(
            "growth",
            "1",
            0.0,
            lower=-1.0,
            upper=1.0,
            prior=GROWTH_KNOWN,
            description="share s by which the loop is wider at twice the reference load",
            source="0: a loop of constant width (play, dry friction)",
        ),
        Parameter(
            "reference_N",
            "N",
            10.0,
            lower=0.01,
            upper=1e4,
            description="load at which the half width holds",
            source="convention; it matters only where the loop grows",
        ),
    ),
    shows="levels visited up and down at one place",
    source=(
        "definition of hysteresis in load-cell data sheets; a loop of constant width (play, dry "
        "friction) is a guess"
    ),
    confused_with={
        "tare_offset": "tare rows and up-and-down order separate them",
        "load_cell_drift": "levels in mixed order separate them",
    },
    benches=frozenset({"sweep"}),
    rig_values=rig_values,
    tolerance_of=tolerance_of,
    readings={"thrust_N": thrust_reading},
)
