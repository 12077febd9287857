"""Derived quantities: powers, efficiencies, coefficients, Mach and Reynolds numbers.

`QUANTITIES` defines them for points, tables, figures, exports and the reference page; a new
quantity is one entry. `data.derived` evaluates them with their errors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from inspect import signature
from math import pi, sqrt

import numpy as np

from benchtool.core.air import sound_speed_m_s, viscosity_Pa_s
from benchtool.core.channel import channel_family, unit_from_name
from benchtool.core.rig import CHORD_RADIUS
from benchtool.core.units import Array, from_si

Of = Callable[..., Array]


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """Derived quantity."""

    name: str  # of its column, with the unit; a column of that name in a recording has priority
    symbol: str
    title: str
    formula: str  # for display
    of: Of  # function of channels, other quantities and known values, by its parameters' names
    source: str = ""  # of the definition

    @property
    def unit(self) -> str:
        """Its unit, one of `core.units.UNITS`."""
        return unit_from_name(self.name)

    @property
    def needs(self) -> tuple[str, ...]:
        """Names of its arguments."""
        return tuple(signature(self.of).parameters)


def _over(numerator: Array, denominator: Array) -> Array:
    """Return a quotient, nan where the denominator is not positive."""
    quotient: Array = numerator / np.where(denominator > 0.0, denominator, np.nan)
    return quotient


def _shaft_torque(
    power_W: Array,
    shaft_rad_s: Array,
    Kv_rpm_V: float,
    resistance_ohm: float,
    no_load_current_A: float,
) -> Array:
    """Return (I - I0)/Kv for the winding current I with (w/Kv + Rm I) I = P: N m."""
    volt_s = 60.0 / (2.0 * pi * Kv_rpm_V)
    induced_V = shaft_rad_s * volt_s
    root = np.sqrt(np.maximum(induced_V**2 + 4.0 * resistance_ohm * power_W, 0.0))
    current_A = (root - induced_V) / (2.0 * resistance_ohm)
    return np.asarray((current_A - no_load_current_A) * volt_s, float)


def _sum_of_powers(speed_rad_s: Array, exponent: int) -> Array:
    turns_per_s = speed_rad_s / (2.0 * pi)
    return np.asarray(np.sum(turns_per_s**exponent, axis=0), float)


PROPELLER_CONVENTION = "propeller convention: n in turns per second, D the diameter (Brandt and "
PROPELLER_CONVENTION += (
    "Selig, AIAA 2011-1255); with several rotors n^2 and n^3 are summed over them"
)

QUANTITIES: tuple[Quantity, ...] = (  # each after its arguments
    Quantity(
        name="power_W", symbol="P_el", title="electrical power", formula="U I",
        of=lambda voltage_V, current_A: voltage_V * current_A,
    ),
    Quantity(
        name="torque_Nm", symbol="Q", title="shaft torque",
        formula="(I_m - I0)/Kv, winding current I_m from (w/Kv + Rm I_m) I_m = P_el",
        of=_shaft_torque,
        source="motor with constant Kv, Rm and I0 behind a lossless ESC (Drela, First-Order DC "
        "Electric Motor Model, 2007); only where no torque is measured",
    ),
    Quantity(
        name="mechanical_power_W", symbol="P_mech", title="mechanical power", formula="Q w",
        of=lambda torque_Nm, shaft_rad_s: torque_Nm * shaft_rad_s,
    ),
    Quantity(
        name="efficiency_N_W", symbol="T/P_el", title="overall efficiency", formula="T/P_el",
        of=lambda thrust_N, power_W: _over(thrust_N, power_W),
    ),
    Quantity(
        name="efficiency_gf_W", symbol="T/P_el", title="overall efficiency",
        formula="T/P_el in gram-force per watt",
        of=lambda efficiency_N_W: from_si(efficiency_N_W, "gf/W"),
    ),
    Quantity(
        name="motor_efficiency", symbol="η_m", title="motor and ESC efficiency",
        formula="P_mech/P_el",
        of=lambda mechanical_power_W, power_W: _over(mechanical_power_W, power_W),
    ),
    Quantity(
        name="propeller_efficiency_N_W", symbol="T/P_mech", title="propeller efficiency",
        formula="T/P_mech",
        of=lambda thrust_N, mechanical_power_W: _over(thrust_N, mechanical_power_W),
    ),
    Quantity(
        name="ct", symbol="C_T", title="thrust coefficient", formula="T/(rho n^2 D^4)",
        of=lambda thrust_N, speed_rad_s, density_kg_m3, diameter_m: _over(
            thrust_N, density_kg_m3 * _sum_of_powers(speed_rad_s, 2) * diameter_m**4
        ),
        source=PROPELLER_CONVENTION,
    ),
    Quantity(
        name="cp", symbol="C_P", title="power coefficient", formula="P_mech/(rho n^3 D^5)",
        of=lambda mechanical_power_W, speed_rad_s, density_kg_m3, diameter_m: _over(
            mechanical_power_W, density_kg_m3 * _sum_of_powers(speed_rad_s, 3) * diameter_m**5
        ),
        source=PROPELLER_CONVENTION,
    ),
    Quantity(
        name="figure_of_merit", symbol="FM", title="figure of merit",
        formula="sqrt(2/pi) C_T^1.5/C_P",
        of=lambda ct, cp: sqrt(2.0 / pi) * _over(np.maximum(ct, 0.0) ** 1.5, cp),
        source="ideal power T^1.5/sqrt(2 rho A) of momentum theory over P_mech, A = pi D^2/4 "
        "(Leishman, Principles of Helicopter Aerodynamics, 2006, section 2.8)",
    ),
    Quantity(
        name="tip_mach", symbol="M_tip", title="tip Mach number", formula="w R/a",
        of=lambda speed_rad_s, diameter_m, air_degC: (
            0.5 * diameter_m * np.max(speed_rad_s, axis=0) / sound_speed_m_s(air_degC)
        ),
        source="a = sqrt(1.4 287.053 K) of dry air (ISO 2533), K its temperature in kelvin",
    ),
    Quantity(
        name="reynolds_75", symbol="Re_75", title="Reynolds number at 75 % of the radius",
        formula="rho (0.75 w R) c/mu",
        of=lambda speed_rad_s, diameter_m, chord_m, density_kg_m3, air_degC: (
            density_kg_m3 * (CHORD_RADIUS * 0.5 * diameter_m * np.max(speed_rad_s, axis=0))
            * chord_m / viscosity_Pa_s(air_degC)
        ),
        source="c is the chord at 75 % of the radius; mu by Sutherland's law (U.S. Standard "
        "Atmosphere 1976, eq. 51)",
    ),
)  # fmt: skip

MEASURED = ("thrust_N", "torque_Nm", "voltage_V", "current_A")  # and speeds


def dependent_quantities(channel: str) -> tuple[str, ...]:
    """Return the quantities that depend on a measured channel."""
    affected = {"speed_rad_s", "shaft_rad_s"} if channel_family(channel) == "rpm" else {channel}
    for quantity in QUANTITIES:
        if quantity.name not in MEASURED and affected & set(quantity.needs):
            affected.add(quantity.name)
    return tuple(quantity.name for quantity in QUANTITIES if quantity.name in affected - {channel})


DATA_SHEET = ("Kv_rpm_V", "resistance_ohm", "no_load_current_A")  # from the motor's data sheet
