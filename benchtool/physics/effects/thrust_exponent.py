"""Thrust does not grow exactly with the square of rotor speed."""

from __future__ import annotations

import numpy as np

from benchtool.core.parameter import Parameter
from benchtool.physics.effects.effect import Effect, Flow, Quantity, Values
from benchtool.physics.expression import expression


@expression
def factor(i: int, flow: Flow, p: Values) -> Quantity:
    """Return (speed / reference)^e: a low-Reynolds-number change of the thrust coefficient."""
    return np.exp(p[0] * np.log(np.maximum(flow.speed_rad_s[i], 1.0) / p[1]))


EFFECT = Effect(
    name="thrust_exponent",
    title="Thrust exponent",
    description="At small Reynolds numbers the thrust coefficient rises with speed.",
    stage="rpm_to_thrust",
    law="T = k w^2 (w / w_ref)^e",
    parameters=(
        Parameter(
            "excess",
            "1",
            0.0,
            neutral=0.0,
            lower=-0.5,
            upper=0.5,
            tolerance=0.02,
            description="exponent beyond 2",
            source="neutral value",
        ),
        Parameter(
            "reference_rad_s",
            "rad/s",
            500.0,
            lower=1.0,
            upper=5000.0,
            description="speed at which k holds",
            source="convention: middle of the usual range",
        ),
    ),
    shows="several throttle levels",
    source="UIUC propeller data: C_T of a 10x7 slow flyer rises 14 % from 2283 to 5987 rpm",
    confused_with={"tare_offset": "several pwm levels separate them"},
    benches=frozenset({"sweep"}),
    separated_by={"k": "several throttle levels, far apart"},
    trends_over=("speed_rad_s",),
    factor=factor,
)
