"""The map from pulse to speed is off: for all rotors alike, and between the two sides."""

from __future__ import annotations

import numpy as np

from benchtool.core.parameter import Parameter, Prior
from benchtool.physics.effects.effect import Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression

KNOWN = Prior("normal", 0.0, 0.005, "assumed: pulses and speeds of a calibrated ESC agree to 0.5 %")


@expression
def speed(i: int, speed_rad_s: Quantity, flow: Flow, p: Values) -> Quantity:
    """Return the speed with the gain changed, more on one side of the hinge: rad/s."""
    side = np.sign(flow.position_x_m[i])
    return speed_rad_s * (1.0 + p[0] + 0.5 * side * p[1])


def _parameter(name: str, description: str) -> Parameter:
    return Parameter(
        name,
        "1",
        0.0,
        neutral=0.0,
        lower=-0.2,
        upper=0.2,
        prior=KNOWN,
        tolerance=0.005,
        description=description,
        source="neutral value",
    )


EFFECT = Effect(
    name="speed_map",
    title="Speed map",
    description=(
        "ESCs turn the same pulse into slightly different speeds. Measured speeds show it at once; "
        "an explanation takes it for something that the bench's owner knows only roughly."
    ),
    stage="pwm_to_rpm",
    law="speed = gain * pulse * (1 + gain error + side * difference / 2)",
    parameters=(
        _parameter("gain", "relative error of the map, all rotors alike"),
        _parameter("difference", "the same, rotors before the hinge over those behind it"),
    ),
    shows="rpm against pulses, on a settled bench too",
    source="definition; the size is a guess",
    confused_with={
        "rotor_asymmetry": "rpm separates them",
        "battery_sag": "it is there from the beginning",
    },
    benches=frozenset(),
    adjusted_on=frozenset({"pitch"}),
    speed=speed,
)
