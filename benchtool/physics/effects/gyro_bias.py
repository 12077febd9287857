"""The gyro's zero is off."""

from __future__ import annotations

from typing import Any

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number


@expression
def gyro_reading(p: Any, i: int, flow: Flow, reading: Quantity) -> Quantity:
    """Return the gyro's reading with the bias on it: rad/s."""
    return reading + p.bias_rad_s


EFFECT = Effect(
    name="gyro_bias",
    title="Gyro bias",
    description="The gyro shows a rate while nothing turns.",
    subsystem="sensor",
    order=10,
    law="reading = rate + bias; where the scale is off, too: scale * (rate + bias)",
    parameters=(
        number(
            "bias_rad_s", "rad/s", 0.0, "what the gyro shows at rest", neutral=0.0,
            within=(-1.0, 1.0), tolerance=0.0035,
        ),
    ),
    hooks=Hooks(gyro_reading=gyro_reading),
    shows="always; against the encoder's slope",
    source="constant bias, the usual first approximation of a MEMS gyro",
    confused_with={"gyro_scale": "fast motion separates them"},
    benches=frozenset({"pitch"}),
    always_compiled=True,
)  # fmt: skip
