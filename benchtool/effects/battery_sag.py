"""The speed that a pulse gives falls as the battery empties."""

from __future__ import annotations

from benchtool.aero.expression import expression
from benchtool.core.parameter import Parameter
from benchtool.effects.effect import Effect, Flow, Quantity, Values


@expression
def speed(i: int, speed_rad_s: Quantity, flow: Flow, p: Values) -> Quantity:
    """Return the speed after a linear loss of the gain with time: rad/s."""
    return speed_rad_s * (1.0 - p[0] * flow.time_s)


EFFECT = Effect(
    name="battery_sag",
    title="Battery sag",
    description="Voltage falls during the run, and with it the speed at a given pulse width.",
    stage="pwm_to_rpm",
    law="speed = gain * pulse * (1 - rate * t)",
    parameters=(
        Parameter(
            "rate_per_s",
            "1/s",
            0.0,
            neutral=0.0,
            lower=-0.01,
            upper=0.01,
            tolerance=0.0005,
            description="linear loss of the pwm-to-rpm gain",
            source="neutral value",
        ),
    ),
    shows="late in the run, at high throttle; the voltage column shows it first",
    source="linear loss over a few minutes; a guess for longer runs",
    confused_with={"load_cell_drift": "the voltage column and rpm separate them"},
    speed=speed,
)
