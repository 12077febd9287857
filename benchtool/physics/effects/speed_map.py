"""Errors of the map from pulse width to speed, common and between the two sides."""

from __future__ import annotations

import numpy as np

from benchtool.core.parameter import Parameter, Prior
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.rig_scaling import half_throttle_speed

GAIN_PRIOR = Prior("normal", 0.0, 0.005, "assumed: calibrated ESC, speeds agree to 0.5 %")
BEND_PRIOR = Prior("normal", 0.0, 0.01, "assumed: 0.1 % of speed a third above or below reference")


def speed(p: Numbers, i: int, flow: Flow, speed_rad_s: Quantity) -> Quantity:
    """Return the speed with gain error, difference between sides and curvature: rad/s."""
    side, excess = np.sign(flow.position_x_m[i]), speed_rad_s / p.middle_rad_s - 1.0
    return speed_rad_s * (1.0 + p.gain + 0.5 * side * p.difference + p.bend * excess * excess)


def _error(name: str, description: str) -> Parameter:
    return number(
        name, "1", 0.0, description, neutral=0.0, within=(-0.2, 0.2), prior=GAIN_PRIOR,
        tolerance=0.005,
    )  # fmt: skip


EFFECT = Effect(
    name="speed_map",
    description=(
        "The speed at a given pulse width deviates from the rig's map and differs between ESCs. "
        "Every explanation adjusts it within its prior."
    ),
    subsystem="pwm_to_rpm",
    order=30,
    law=(
        "speed = gain * pulse * "
        "(1 + gain error + side * difference / 2 + c (speed / reference - 1)^2)"
    ),
    parameters=(
        _error("gain", "relative gain error of all rotors"),
        _error("difference", "relative difference, rotors in front of the hinge minus behind"),
        number(
            "bend", "1", 0.0, "strength c of the quadratic deviation",
            neutral=0.0, within=(-0.5, 0.5), tolerance=0.01, prior=BEND_PRIOR,
        ),
        number(
            "middle_rad_s", "rad/s", 600.0, "reference speed, without quadratic deviation",
            within=(1.0, 1e5), source="middle of the usual range; from a rig: half throttle",
        ),
    ),
    hooks=Hooks(speed=speed),
    shows="speed against pulse width, also at steady state",
    source="definition; magnitude assumed",
    confused_with={
        "rotor_asymmetry": "rpm separates them",
        "battery_sag": "the start of the run separates them",
    },
    benches=frozenset(),
    adjusted_on=frozenset({"pitch"}),
    rig_values=lambda rig: {"middle_rad_s": half_throttle_speed(rig)},
)  # fmt: skip
