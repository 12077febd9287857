"""A rotor's lag depends on its speed and on whether it speeds up: it is no constant."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from benchtool.core.parameter import Parameter, Prior
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number
from benchtool.physics.rig_scaling import half_throttle_speed


@expression
def followed_speed(p: Any, i: int, flow: Flow, speed_rad_s: Quantity) -> Quantity:
    """Return the speed after a short step that goes farther the quicker the rotor is: rad/s."""
    change = speed_rad_s - flow.speed_rad_s[i]
    faster = flow.speed_rad_s[i] / p.middle_rad_s - 1.0
    return speed_rad_s + change * (p.with_speed * faster - p.rising * np.sign(change))


def rig_values(rig: Rig) -> Mapping[str, float]:
    """Return the speed at half throttle: rad/s."""
    return {"middle_rad_s": half_throttle_speed(rig)}


def _share(name: str, sd: float, description: str, why: str) -> Parameter:
    return number(
        name, "1", 0.0, description, neutral=0.0, within=(-0.9, 0.9),
        prior=Prior("normal", 0.0, sd, f"assumed: {why}"), tolerance=sd,
    )  # fmt: skip


EFFECT = Effect(
    name="lag_shape",
    title="Shape of the motor lag",
    description=(
        "A loaded rotor follows quicker at higher speed; an ESC that brakes less than it drives "
        "makes it slow down later than it speeds up. An explanation takes it for something "
        "that the bench's owner knows only roughly."
    ),
    subsystem="pwm_to_rpm",
    order=25,
    law="1/tau is multiplied by 1 + e (speed / reference - 1) - a sign(commanded - speed)",
    parameters=(
        _share(
            "with_speed", 0.15, "share e by which 1/tau grows with speed over the reference",
            "of 1/tau a half at most is the propeller's drag, which grows with speed",
        ),
        _share(
            "rising", 0.03, "share a by which the lag is longer when a rotor speeds up",
            "ESCs that brake do it nearly as well as they drive",
        ),
        number(
            "middle_rad_s", "rad/s", 600.0, "speed at which the lag is the stated one",
            within=(1.0, 1e5), source="middle of the usual range; a rig states half throttle",
        ),
    ),
    hooks=Hooks(followed_speed=followed_speed),
    shows="changes of pulse width at several collectives",
    source="linearised drag torque of a propeller, 2 Q/w; the sizes are guesses",
    confused_with={
        "motor_lag": "one collective shows no difference",
        "aerodynamic_damping": "in a closed loop a lag that changes by 1 ms looks like a tolerance",
    },
    benches=frozenset(),
    adjusted_on=frozenset({"pitch"}),
    acts_in_flight=False,
    rig_values=rig_values,
)  # fmt: skip
