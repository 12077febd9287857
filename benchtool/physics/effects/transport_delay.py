"""Transport delay of commands to the motors."""

from __future__ import annotations

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number


def delay_s(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return the delay: s."""
    return p.delay_s


EFFECT = Effect(
    name="transport_delay",
    description="Commands reach the motors with a constant delay.",
    subsystem="pwm_to_rpm",
    order=10,
    law="pulse at the motor (t) = command (t - delay)",
    parameters=(
        number(
            "delay_s", "s", 0.0, "time between a command and its arrival at the motors",
            neutral=0.0, within=(0.0, 0.2), tolerance=0.002,
        ),
    ),
    hooks=Hooks(delay_s=delay_s),
    shows="changes of pulse width; never on a settled bench",
    source="pure delay: bus, ESC input filter, PWM period",
    confused_with={"motor_lag": "dither above 5 Hz, or rpm telemetry, separates them"},
    benches=frozenset({"pitch"}),
)  # fmt: skip
