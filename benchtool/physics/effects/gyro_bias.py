"""Bias of the gyro."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number


def gyro_reading(p: Numbers, i: int, flow: Flow, reading: Quantity) -> Quantity:
    """Return the reading with the bias: rad/s."""
    return reading + p.bias_rad_s


EFFECT = Effect(
    name="gyro_bias",
    description="The gyro reading has a constant offset.",
    subsystem="sensor",
    order=10,
    law="reading = rate + bias; with gyro_scale: scale * (rate + bias)",
    parameters=(
        number(
            "bias_rad_s", "rad/s", 0.0, "reading at rest", neutral=0.0,
            within=(-1.0, 1.0), tolerance=0.0035,
        ),
    ),
    hooks=Hooks(gyro_reading=gyro_reading),
    shows="always, compared with the derivative of the encoder angle",
    source="constant bias, first approximation of a MEMS gyro",
    confused_with={"gyro_scale": "fast motion separates them"},
    benches=frozenset({"pitch"}),
    always_compiled=True,
)  # fmt: skip
