"""Motor lag that depends on speed and on the sign of the acceleration."""

from __future__ import annotations

import numpy as np

from benchtool.core.parameter import Parameter, Prior
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.rig_scaling import half_throttle_speed


def followed_speed(p: Numbers, i: int, flow: Flow, speed_rad_s: Quantity) -> Quantity:
    """Return the speed after a short step, with a lag that depends on speed: rad/s."""
    change = speed_rad_s - flow.speed_rad_s[i]
    relative_speed = flow.speed_rad_s[i] / p.middle_rad_s - 1.0
    return speed_rad_s + change * (p.with_speed * relative_speed - p.rising * np.sign(change))


def _share(name: str, sd: float, description: str, reason: str) -> Parameter:
    return number(
        name, "1", 0.0, description, neutral=0.0, within=(-0.9, 0.9),
        prior=Prior("normal", 0.0, sd, f"assumed: {reason}"), tolerance=sd,
    )  # fmt: skip


EFFECT = Effect(
    name="lag_shape",
    title="Shape of the motor lag",
    description=(
        "The lag of a loaded rotor decreases with speed. It is longer during deceleration if the "
        "ESC brakes less than it drives. Every explanation adjusts it within its prior."
    ),
    subsystem="pwm_to_rpm",
    order=25,
    law="1/tau is multiplied by 1 + e (speed / reference - 1) - a sign(commanded - speed)",
    parameters=(
        _share(
            "with_speed", 0.15, "relative increase e of 1/tau at twice the reference speed",
            "at most half of 1/tau is the propeller's drag, which grows with speed",
        ),
        _share(
            "rising", 0.03, "relative decrease a of 1/tau during acceleration",
            "ESCs with active braking decelerate nearly as fast as they accelerate",
        ),
        number(
            "middle_rad_s", "rad/s", 600.0, "reference speed, at which 1/tau is unchanged",
            within=(1.0, 1e5), source="middle of the usual range; from a rig: half throttle",
        ),
    ),
    hooks=Hooks(followed_speed=followed_speed),
    shows="changes of pulse width at several collectives",
    source="linearised drag torque of a propeller, 2 Q/w; magnitudes assumed",
    confused_with={
        "motor_lag": "several collectives separate them",
        "aerodynamic_damping": "in a closed loop, 1 ms of lag looks like one tolerance of damping",
    },
    benches=frozenset(),
    adjusted_on=frozenset({"pitch"}),
    acts_in_flight=False,
    rig_values=lambda rig: {"middle_rad_s": half_throttle_speed(rig)},
)  # fmt: skip
