"""Loss of ground effect with forward speed."""

from __future__ import annotations

import numpy as np

from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number


def image_share(p: Numbers, i: int, flow: Flow) -> Quantity:
    """Return 1/(1 + s (V/v)^2), v^2 = sqrt(V^4/4 + v_h^4) - V^2/2 by momentum theory."""
    half = 0.5 * flow.airspeed_m_s * flow.airspeed_m_s
    hover = p.hover_inflow_m_s * p.hover_inflow_m_s
    inflow = np.sqrt(half * half + hover * hover) - half
    return 1.0 / (1.0 + p.strength * 2.0 * half / inflow)


EFFECT = Effect(
    name="forward_speed",
    description=(
        "Airspeed along the surface reduces the effect of all images. The formula is from public "
        "code and not verified against the report, so its strength has to be fitted. Simulated "
        "flights use the ground speed, without wind."
    ),
    subsystem="rpm_to_thrust",
    order=48,
    law="denominator - D/(1 + s (V/v)^2), D the sum of all terms; v^4 + V^2 v^2 = v_h^4",
    parameters=(
        number(
            "strength", "1", 0.0, "strength s of the loss; 1 is the form of public code",
            neutral=0.0, within=(0.0, 5.0), tolerance=0.2,
        ),
        number(
            "hover_inflow_m_s", "m/s", 6.0,
            "induced velocity v_h in hover, sqrt(T/(2 rho pi R^2)) of one rotor",
            within=(0.5, 50.0), source="assumed: 3.4 N on a disc of 0.12 m radius gives 5.6 m/s",
        ),
    ),
    hooks=Hooks(image_share=image_share),
    shows="several airspeeds along a near surface; not in still air",
    source=(
        "Cheeseman and Bennett 1955, ARC R&M 3021, as in Synetic-Labs/SkyFlow-Dynamics "
        "spec/ground_effect.py, which flags it as unverified; v by momentum theory"
    ),
    benches=frozenset(),
)  # fmt: skip
