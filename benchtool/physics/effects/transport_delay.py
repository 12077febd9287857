"""Commands take their time to the motors."""

from __future__ import annotations

from benchtool.core.parameter import Parameter
from benchtool.physics.effects.effect import Effect, Quantity, Values
from benchtool.physics.expression import expression


@expression
def delay_s(p: Values) -> Quantity:
    """Return the delay: s."""
    return p[0]


EFFECT = Effect(
    name="transport_delay",
    title="Transport delay",
    description="A command reaches the motors some time after it was given.",
    stage="pwm_to_rpm",
    law="pulse at the motor (t) = command (t - delay)",
    parameters=(
        Parameter(
            "delay_s",
            "s",
            0.0,
            neutral=0.0,
            lower=0.0,
            upper=0.2,
            tolerance=0.002,
            description="time between a command and its arrival at the motors",
            source="neutral value",
        ),
    ),
    shows="changes of pulse width; never on a settled bench",
    source="pure delay: bus, ESC input filter, PWM period",
    confused_with={"motor_lag": "dither above 5 Hz, or rpm telemetry, separates them"},
    benches=frozenset({"pitch"}),
    delay_s=delay_s,
)
