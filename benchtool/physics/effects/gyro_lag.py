"""Lag of the gyro's low-pass filter."""

from __future__ import annotations

from benchtool.core.parameter import Prior
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number


def gyro_reading(p: Numbers, i: int, flow: Flow, reading_rad_s: Quantity) -> Quantity:
    """Return the delayed rate, to first order in the delay: rad/s."""
    return reading_rad_s - p.late_s * flow.acceleration_rad_s2


EFFECT = Effect(
    name="gyro_lag",
    title="Lag of the gyro",
    description=(
        "The gyro's low-pass filter delays the rate. Every explanation adjusts it within its "
        "prior."
    ),
    subsystem="sensor",
    order=5,
    law="reading = rate - delay * acceleration",
    parameters=(
        number(
            "late_s", "s", 0.0,
            "delay well below the corner f: 1/(2 pi f) of a first-order filter",
            neutral=0.0, within=(-0.005, 0.005),
            prior=Prior("normal", 0.0, 0.0005, "assumed: corners of 180 to 400 Hz are usual"),
            tolerance=0.0005,
        ),
    ),
    hooks=Hooks(gyro_reading=gyro_reading),
    shows="fast changes of the rate; the encoder leads",
    source="first-order filter, well below its corner",
    confused_with={"gyro_scale": "fast and slow motion separate them"},
    benches=frozenset(),
    adjusted_on=frozenset({"pitch"}),
    acts_in_flight=False,
)  # fmt: skip
