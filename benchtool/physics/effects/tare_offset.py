"""The load cell was not at zero when it was tared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import BenchKind, Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression
from benchtool.physics.size import weight_scale


@expression
def thrust_reading(
    reading: Quantity, flow: Flow, states: Sequence[Quantity], p: Values
) -> Quantity:
    """Return the reading with a constant on it: N."""
    return reading + p[0]


def tolerance_of(rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the force that matters (a guess), in the measure of the weight: N."""
    return {"thrust_N": 0.02 * weight_scale(rig)}


EFFECT = Effect(
    name="tare_offset",
    title="Tare offset",
    description="A constant stands on every thrust reading: the cell was tared under load.",
    stage="sensor",
    law="reading = thrust + offset",
    parameters=(
        Parameter(
            "thrust_N",
            "N",
            0.0,
            neutral=0.0,
            lower=-5.0,
            upper=5.0,
            description="constant on the reading",
            source="neutral value",
        ),
    ),
    shows="low throttle, zero throttle",
    source="arithmetic of a tare",
    confused_with={"load_cell_hysteresis": "tare rows and up-and-down order separate them"},
    benches=frozenset({"sweep"}),
    separated_by={
        "k": "several throttle levels, among them a low one",
        "calibration.offset_N": "a tare with the motors off",
    },
    trends_over=("speed_rad_s",),
    tolerance_of=tolerance_of,
    readings={"thrust_N": thrust_reading},
)
