"""The gyro's filter delays its reading."""

from __future__ import annotations

from typing import Any

from benchtool.core.parameter import Prior
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number


@expression
def gyro_reading(p: Any, i: int, flow: Flow, reading_rad_s: Quantity) -> Quantity:
    """Return the rate of a moment ago: rad/s."""
    return reading_rad_s - p.late_s * flow.acceleration_rad_s2


EFFECT = Effect(
    name="gyro_lag",
    title="Lag of the gyro",
    description=(
        "A gyro's low-pass filter shows the rate a moment late. An explanation takes it for "
        "something that the bench's owner knows only roughly."
    ),
    subsystem="sensor",
    order=5,
    law="reading = rate - late * acceleration",
    parameters=(
        number(
            "late_s", "s", 0.0,
            "delay of a slow change: 1/(2 pi f) of a filter of first order, f its corner",
            neutral=0.0, within=(-0.005, 0.005),
            prior=Prior("normal", 0.0, 0.0005, "assumed: corners of 180 to 400 Hz are usual"),
            tolerance=0.0005,
        ),
    ),
    hooks=Hooks(gyro_reading=gyro_reading),
    shows="quick changes of the rate; the encoder leads",
    source="a filter of first order, far below its corner",
    confused_with={"gyro_scale": "quick and slow motion separate them"},
    benches=frozenset(),
    adjusted_on=frozenset({"pitch"}),
    acts_in_flight=False,
)  # fmt: skip
