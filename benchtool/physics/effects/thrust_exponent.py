"""Deviation of thrust from the square of rotor speed (Reynolds number)."""

from __future__ import annotations

import numpy as np

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number


def factor(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return (speed / reference)^e, the relative change of the thrust coefficient."""
    return np.exp(p.excess * np.log(np.maximum(flow.speed_rad_s[i], 1.0) / p.reference_rad_s))


EFFECT = Effect(
    name="thrust_exponent",
    description=(
        "The thrust coefficient k of small rotors increases with the Reynolds number. A power law "
        "leaves residuals of 0.4 to 1.5 % for three measured propellers; 1/w and 1/sqrt(w) leave "
        "more."
    ),
    subsystem="rpm_to_thrust",
    order=60,
    law="T = k w^2 (w / w_ref)^e",
    parameters=(
        number(
            "excess", "1", 0.0, "exponent beyond 2", neutral=0.0, within=(-0.5, 0.5), tolerance=0.02
        ),
        number(
            "reference_rad_s", "rad/s", 500.0, "reference speed of k", within=(1.0, 5000.0),
            source="convention: middle of the usual range",
        ),
    ),
    hooks=Hooks(factor=factor),
    shows="several throttle levels",
    source="UIUC propeller data: C_T of a 10x7 slow flyer rises 14 % from 2283 to 5987 rpm",
    confused_with={"tare_offset": "several throttle levels separate them"},
    separated_by={"k": "several throttle levels, far apart"},
    trends_over=("speed_rad_s",),
    benches=frozenset({"sweep"}),
)  # fmt: skip
