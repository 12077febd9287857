"""The load cell was not at zero when it was tared."""

from __future__ import annotations

from collections.abc import Sequence

from benchtool.aero.expression import expression
from benchtool.core.parameter import Parameter
from benchtool.effects.effect import Effect, Flow, Quantity, Values


@expression
def thrust_reading(
    reading: Quantity, flow: Flow, states: Sequence[Quantity], p: Values
) -> Quantity:
    """Return the reading with a constant on it: N."""
    return reading + p[0]


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
            tolerance=0.02,
            description="constant on the reading",
            source="neutral value",
        ),
    ),
    shows="low throttle, zero throttle",
    source="arithmetic of a tare",
    confused_with={"load_cell_hysteresis": "tare rows and up-and-down order separate them"},
    readings={"thrust_N": thrust_reading},
)
