"""Thrust and torque ratios at equal rotor speed, from a law at equal induced power."""

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
    """Return the parameters of the rig's blades; empty for a rig without [blade]."""
    if rig.blade is None:
        return {}
    return {"response": inflow_response(rig.blade), "profile_share": profile_share(rig.blade)}


EFFECT = Effect(
    name="blade_inflow",
    title="Blades in slower inflow",
    description=(
        "Eqs. (2) to (4) hold at equal induced power. At equal speed, blades in the slower inflow "
        "near a plate gain less thrust (25 % instead of 33 % at z/R 0.5). Without this effect "
        "(rigs without [blade]) the factor holds at equal speed, as in eq. (10)."
    ),
    subsystem="rpm_to_thrust",
    order=45,
    law="kappa = F^(-3/2); F -> C_T(kappa)/C_T(1), torque -> C_Q(kappa)/C_Q(1)",
    parameters=(
        number(
            "share", "1", 1.0, "share of the theoretical response; 0 is eq. (10) as printed",
            neutral=0.0, within=(0.0, 1.5), tolerance=0.05, source="blade-element momentum theory",
        ),
        number(
            "response", "1", 1.0,
            "m = s a / (4 sqrt(2 C_T)) of solidity, lift slope and thrust coefficient",
            within=(0.0, 10.0),
            source="assumed: 0.9 to 1.1 for small propellers; else from [blade] of the rig",
        ),
        number(
            "profile_share", "1", 0.3, "share of profile drag in the torque out of ground effect",
            within=(0.0, 1.0),
            source="assumed: figure of merit near 0.7; else from [blade] of the rig",
        ),
    ),
    hooks=Hooks(response=response, drag=drag),
    shows="thrust ratio at equal speed below that at equal power; speed at a fixed pulse",
    source=(
        "Leishman 2006, chapter 3 (from memory; untwisted blades, uniform inflow); with inflow "
        "solved per annulus the increment is 4 % smaller"
    ),
    confused_with={"ground_shape": "pulse widths or power, in addition to speeds, separate them"},
    separated_by={"R_m": "ratios both at equal power and at equal speed"},
    benches=frozenset(),
    rig_values=rig_values,
)  # fmt: skip
