"""Rotor speed follows its command with a first-order lag."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchtool.core.parameter import Parameter
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import Effect, OwnState, Quantity, Values
from benchtool.physics.expression import expression


@expression
def rate(state: Quantity, drive: Quantity, p: Values) -> Quantity:
    """Return the change of speed: (commanded - present) / tau, rad/s2."""
    return (drive - state) / p[0]


@expression
def settled(drive: Quantity, elapsed_s: Quantity, p: Values) -> Quantity:
    """Return the commanded speed: a bench held still has no lag left."""
    return drive


@expression
def kept(dt_s: Quantity, p: Values) -> Quantity:
    """Return exp(-dt / tau): what is left of the distance to a held command; 0 without lag."""
    return np.exp(-dt_s / np.maximum(p[0], 1e-12))


def rig_values(rig: Rig) -> Mapping[str, float]:
    """Return the lag of the rig's motors: s."""
    return {"tau_s": rig.propulsion.lag_s}


EFFECT = Effect(
    name="motor_lag",
    title="Motor lag",
    description="Motor, ESC and rotor inertia delay the speed behind the pulse width.",
    stage="pwm_to_rpm",
    law="d(speed)/dt = (commanded - speed) / tau",
    parameters=(
        Parameter(
            "tau_s",
            "s",
            0.0,
            neutral=0.0,
            lower=0.0,
            upper=1.0,
            tolerance=0.002,
            description="time constant, the whole lag",
            source="neutral value; a rig states its own",
        ),
    ),
    shows="changes of pulse width; never on a settled bench",
    source="first-order model, usual for small brushless motors",
    confused_with={"transport_delay": "dither above 5 Hz, or rpm telemetry, separates them"},
    benches=frozenset({"pitch"}),
    rig_values=rig_values,
    states=(
        OwnState(
            name="speed",
            drive="speed_rad_s",
            rate=rate,
            settled=settled,
            kept=kept,
            time_constant="tau_s",
        ),
    ),
)
