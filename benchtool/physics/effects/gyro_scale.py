"""Scale error of the gyro."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number


def gyro_reading(p: Numbers, i: int, flow: Flow, reading: Quantity) -> Quantity:
    """Return the scaled reading, bias included: rad/s."""
    return reading * p.scale


EFFECT = Effect(
    name="gyro_scale",
    title="Gyro scale error",
    description="The gyro reading is proportional to the rate, with a factor other than 1.",
    subsystem="sensor",
    order=20,
    law="reading = scale * rate; with gyro_bias: scale * (rate + bias)",
    parameters=(
        number(
            "scale", "1", 1.0, "reading over true rate", neutral=1.0, within=(0.2, 5.0),
            tolerance=0.02,
        ),
    ),
    hooks=Hooks(gyro_reading=gyro_reading),
    shows="fast motion, compared with the derivative of the encoder angle",
    source="linear scale error; data sheets of MEMS gyros state 1 to 3 %",
    confused_with={"gyro_bias": "standstill separates them"},
    benches=frozenset({"pitch"}),
    always_compiled=True,
)  # fmt: skip
