"""The map from pulse to speed is off: for all rotors alike, and between the two sides."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchtool.core.parameter import Parameter, Prior
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number
from benchtool.physics.rig_scaling import half_throttle_speed

KNOWN = Prior("normal", 0.0, 0.005, "assumed: pulses and speeds of a calibrated ESC agree to 0.5 %")
BENT = Prior("normal", 0.0, 0.01, "assumed: 0.1 % of speed at a third above half throttle or below")


@expression
def speed(p: Any, i: int, flow: Flow, speed_rad_s: Quantity) -> Quantity:
    """Return the speed with the gain changed, more on one side of the hinge: rad/s."""
    side, beyond = np.sign(flow.position_x_m[i]), speed_rad_s / p.middle_rad_s - 1.0
    return speed_rad_s * (1.0 + p.gain + 0.5 * side * p.difference + p.bend * beyond * beyond)


def rig_values(rig: Rig) -> Mapping[str, float]:
    """Return the speed at half throttle: rad/s."""
    return {"middle_rad_s": half_throttle_speed(rig)}


def _error(name: str, description: str) -> Parameter:
    return number(
        name, "1", 0.0, description, neutral=0.0, within=(-0.2, 0.2), prior=KNOWN, tolerance=0.005
    )


EFFECT = Effect(
    name="speed_map",
    title="Speed map",
    description=(
        "ESCs turn the same pulse into slightly different speeds. Measured speeds show it at once; "
        "an explanation takes it for something that the bench's owner knows only roughly."
    ),
    subsystem="pwm_to_rpm",
    order=30,
    law=(
        "speed = gain * pulse * "
        "(1 + gain error + side * difference / 2 + c (speed / reference - 1)^2)"
    ),
    parameters=(
        _error("gain", "relative error of the map, all rotors alike"),
        _error("difference", "the same, rotors before the hinge over those behind it"),
        number(
            "bend", "1", 0.0, "strength c of the part that grows with the square of the speed",
            neutral=0.0, within=(-0.5, 0.5), tolerance=0.01, prior=BENT,
        ),
        number(
            "middle_rad_s", "rad/s", 600.0, "speed at which that part is nothing",
            within=(1.0, 1e5), source="middle of the usual range; a rig states half throttle",
        ),
    ),
    hooks=Hooks(speed=speed),
    shows="rpm against pulses, on a settled bench too",
    source="definition; the size is a guess",
    confused_with={
        "rotor_asymmetry": "rpm separates them",
        "battery_sag": "it is there from the beginning",
    },
    benches=frozenset(),
    adjusted_on=frozenset({"pitch"}),
    rig_values=rig_values,
)  # fmt: skip
