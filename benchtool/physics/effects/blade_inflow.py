"""Blades in a slower inflow: thrust at equal rotor speed, where the law is at equal power."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from benchtool.core.rig import Rig
from benchtool.physics.blade_element import (
    inflow_at_equal_thrust,
    inflow_response,
    profile_share,
    thrust_at_equal_speed,
    torque_at_equal_speed,
)
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Quantity, expression, number


@expression
def response(p: Any, i: int, flow: Flow, factor: Quantity) -> Quantity:
    """Return the thrust ratio at equal speed for the factor at equal induced power."""
    kappa = inflow_at_equal_thrust(factor)
    return factor + p.share * (thrust_at_equal_speed(kappa, p.response) - factor)


@expression
def drag(p: Any, i: int, flow: Flow, factor: Quantity) -> Quantity:
    """Return the torque ratio at equal speed for the factor at equal induced power."""
    kappa = inflow_at_equal_thrust(factor)
    return 1.0 + p.share * (torque_at_equal_speed(kappa, p.response, p.profile_share) - 1.0)


def rig_values(rig: Rig) -> Mapping[str, float]:
    """Return the numbers of the rig's blades; none where it states no blades."""
    if rig.blade is None:
        return {}
    return {"response": inflow_response(rig.blade), "profile_share": profile_share(rig.blade)}


EFFECT = Effect(
    name="blade_inflow",
    title="Blades in slower inflow",
    description=(
        "The factor of eqs. (2) to (4) holds at equal induced power. A plate slows the inflow, and "
        "blades at equal speed answer with less thrust than that factor (25 % for 33 % at z/R "
        "0.5), and with another torque. Without this effect the factor holds at equal speed, as "
        "eq. (10) prints it. A rig with a table [blade] has it."
    ),
    subsystem="rpm_to_thrust",
    order=45,
    law="kappa = F^(-3/2); F -> C_T(kappa)/C_T(1), torque -> C_Q(kappa)/C_Q(1)",
    parameters=(
        number(
            "share", "1", 1.0, "how far blades answer as the theory says; 0 is eq. (10) as printed",
            neutral=0.0, within=(0.0, 1.5), tolerance=0.05, source="blade-element momentum theory",
        ),
        number(
            "response", "1", 1.0,
            "m = s a / (4 sqrt(2 C_T)) of solidity, lift slope and thrust coefficient",
            within=(0.0, 10.0),
            source="assumed: 0.9 to 1.1 for small propellers; a rig's [blade] states it",
        ),
        number(
            "profile_share", "1", 0.3, "share of profile drag in the torque far from the plate",
            within=(0.0, 1.0),
            source="assumed: figure of merit near 0.7; a rig's [blade] states it",
        ),
    ),
    hooks=Hooks(response=response, drag=drag),
    shows="thrust at equal speed below, at equal power on the law; speed at a fixed pulse",
    source=(
        "Leishman 2006, chapter 3 (from memory; untwisted blades, uniform inflow); inflow solved "
        "ring by ring makes the increment 4 % of itself smaller"
    ),
    confused_with={"ground_shape": "pulses or power beside speeds separate them"},
    separated_by={"R_m": "ratios at equal power beside those at equal speed"},
    benches=frozenset(),
    rig_values=rig_values,
)  # fmt: skip
