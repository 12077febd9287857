"""Thrust and torque ratios at equal rotor speed, from a law at equal induced power.

Blade-element momentum theory: response of thrust and torque to the inflow.

Untwisted blades and uniform inflow lambda = kappa sqrt(C_T/2), kappa the induced velocity over that
out of ground effect at equal thrust:

    C_T = (s a/2) (t/3 - lambda/2),  C_Q = lambda C_T + s cd/8

with solidity s, lift slope a, pitch t and profile drag cd; T = rho A R^2 C_T w^2 and
Q = rho A R^3 C_Q w^2. The first is quadratic in sqrt(C_T). Relative to kappa = 1, thrust depends
only on m = s a / (4 sqrt(2 C_T)), torque on m and the share of profile drag:
dlnT/dln kappa = -m / (1 + m/2) and, for the induced torque, (1 - m) / (1 + m/2) at equal speed.
Towards a plate, induced torque decreases for m < 1 and first increases for m > 1.

Error of this model: with inflow solved per annulus, the increment at equal speed of untwisted
blades is 4 % smaller (`tests/unit/physics/test_blade_element.py`).

Source: textbook theory of a hovering rotor (Leishman 2006, chapter 3: from memory).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from benchtool.core.rig import Blade, Rig
from benchtool.physics.effects.effect import Effect, Flow, Hooks, Numbers, Quantity, number
from benchtool.physics.expression import expression


@expression
def inflow_at_equal_thrust(factor: Quantity) -> Quantity:
    """Return kappa = G^(-3/2) for the thrust ratio G at equal induced power.

    Induced power T v with v = kappa sqrt(T / 2 rho A) is constant for constant T^(3/2) kappa. For a
    denominator of 0 or less, where a law is undefined, kappa is 0.
    """
    inverse = np.maximum(1.0 / factor, 0.0)
    return inverse * np.sqrt(inverse)


@expression
def thrust_coefficient(
    solidity: Quantity, lift_slope: Quantity, pitch_rad: Quantity, kappa: Quantity
) -> Quantity:
    """Return C_T for an inflow ratio kappa."""
    half = solidity * lift_slope * kappa / (8.0 * np.sqrt(2.0))
    static = solidity * lift_slope * pitch_rad / 6.0
    root = static / (half + np.sqrt(half * half + static))
    return root * root


@expression
def torque_coefficient(
    solidity: Quantity, profile_drag: Quantity, kappa: Quantity, c_T: Quantity
) -> Quantity:
    """Return C_Q for an inflow ratio kappa and a thrust coefficient c_T."""
    return kappa * c_T * np.sqrt(0.5 * c_T) + solidity * profile_drag / 8.0


@expression
def thrust_at_equal_speed(kappa: Quantity, response: Quantity) -> Quantity:
    """Return C_T(kappa) / C_T(1)."""
    slope = response * kappa
    total = 1.0 + response
    root = 2.0 * total / (slope + np.sqrt(slope * slope + 4.0 * total))
    return root * root


@expression
def torque_at_equal_speed(kappa: Quantity, response: Quantity, profile_share: Quantity) -> Quantity:
    """Return C_Q(kappa) / C_Q(1); `profile_share` is the share of profile drag in C_Q(1)."""
    thrust = thrust_at_equal_speed(kappa, response)
    return profile_share + (1.0 - profile_share) * kappa * thrust * np.sqrt(thrust)


def inflow_response(blade: Blade) -> float:
    """Return m = s a / (4 sqrt(2 C_T)) out of ground effect."""
    c_T = thrust_coefficient(blade.solidity, blade.lift_slope, blade.pitch_rad, 1.0)
    return float(blade.solidity * blade.lift_slope / (4.0 * np.sqrt(2.0 * c_T)))


def profile_share(blade: Blade) -> float:
    """Return the share of profile drag in the torque out of ground effect."""
    c_T = thrust_coefficient(blade.solidity, blade.lift_slope, blade.pitch_rad, 1.0)
    c_Q = torque_coefficient(blade.solidity, blade.profile_drag, 1.0, c_T)
    return float(blade.solidity * blade.profile_drag / 8.0 / c_Q)


def response(p: Numbers, i: int, flow: Flow, factor: Quantity) -> Quantity:
    """Return the thrust ratio at equal speed for the factor at equal induced power."""
    kappa = inflow_at_equal_thrust(factor)
    return factor + p.share * (thrust_at_equal_speed(kappa, p.response) - factor)


def drag(p: Numbers, i: int, flow: Flow, factor: Quantity) -> Quantity:
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
