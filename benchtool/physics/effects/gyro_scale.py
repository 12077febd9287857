"""The gyro's scale is off."""

from __future__ import annotations

from collections.abc import Sequence

from benchtool.core.parameter import Parameter
from benchtool.physics.effects.effect import Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression


@expression
def gyro_reading(reading: Quantity, flow: Flow, states: Sequence[Quantity], p: Values) -> Quantity:
    """Return the gyro's reading, scaled: rad/s. It comes after the bias, which is scaled, too."""
    return reading * p[0]


EFFECT = Effect(
    name="gyro_scale",
    title="Gyro scale error",
    description="The gyro shows more or less than the rate.",
    stage="sensor",
    law="reading = scale * rate; where there is a bias, too: scale * (rate + bias)",
    parameters=(
        Parameter(
            "scale",
            "1",
            1.0,
            neutral=1.0,
            lower=0.2,
            upper=5.0,
            tolerance=0.02,
            description="reading over true rate",
            source="neutral value",
        ),
    ),
    shows="fast motion; against the encoder's slope",
    source="linear scale error, data sheets of MEMS gyros state 1 to 3 %",
    confused_with={"gyro_bias": "rest separates them"},
    benches=frozenset({"pitch"}),
    readings={"gyro_rad_s": gyro_reading},
)
