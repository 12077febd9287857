"""The gyro's zero is off."""

from __future__ import annotations

from collections.abc import Sequence

from benchtool.core.parameter import Parameter
from benchtool.physics.effects.effect import Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression


@expression
def gyro_reading(reading: Quantity, flow: Flow, states: Sequence[Quantity], p: Values) -> Quantity:
    """Return the gyro's reading with the bias on it: rad/s."""
    return reading + p[0]


EFFECT = Effect(
    name="gyro_bias",
    title="Gyro bias",
    description="The gyro shows a rate while nothing turns.",
    stage="sensor",
    law="reading = rate + bias; where the scale is off, too: scale * (rate + bias)",
    parameters=(
        Parameter(
            "bias_rad_s",
            "rad/s",
            0.0,
            neutral=0.0,
            lower=-1.0,
            upper=1.0,
            tolerance=0.0035,
            description="what the gyro shows at rest",
            source="neutral value",
        ),
    ),
    shows="always; against the encoder's slope",
    source="constant bias, the usual first approximation of a MEMS gyro",
    confused_with={"gyro_scale": "fast motion separates them"},
    benches=frozenset({"pitch"}),
    readings={"gyro_rad_s": gyro_reading},
)
