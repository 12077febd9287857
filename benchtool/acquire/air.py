"""Density of moist air from temperature, pressure and humidity."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp

from benchtool.core.errors import InputError

CARBON_DIOXIDE = 0.0004
"""Mole fraction of carbon dioxide: 400 ppm, the reference value of CIPM-2007."""

TEMPERATURES_DEGC = (-40.0, 60.0)
PRESSURES_PA = (50_000.0, 110_000.0)
HUMIDITIES = (0.0, 1.0)
"""Least and greatest that is taken for a measurement; choices, wide enough for any laboratory."""


@dataclass(frozen=True, slots=True)
class Air:
    """Hold the state of the air around the bench.

    Attributes:
        temperature_degC: of the air.
        pressure_Pa: at the bench, not reduced to sea level.
        humidity: relative, 0 to 1.
        measured: False when nobody gave the values and the standard ones stand for them.
    """

    temperature_degC: float = 15.0
    pressure_Pa: float = 101_325.0
    humidity: float = 0.0
    measured: bool = False

    def __post_init__(self) -> None:
        for name, value, (low, high), unit in (
            ("temperature", self.temperature_degC, TEMPERATURES_DEGC, "degC"),
            ("pressure", self.pressure_Pa, PRESSURES_PA, "Pa"),
            ("humidity", self.humidity, HUMIDITIES, "(0 to 1)"),
        ):
            if not low <= value <= high:
                raise InputError(
                    f"air {name} {value:g} {unit} is outside {low:g} to {high:g}; correct it"
                )

    @property
    def density_kg_m3(self) -> float:
        """Density of the air."""
        return air_density_kg_m3(self.temperature_degC, self.pressure_Pa, self.humidity)


def air_density_kg_m3(temperature_degC: float, pressure_Pa: float, humidity: float) -> float:
    """Return the density of moist air: kg/m3.

    CIPM-2007 (Picard, Davis, Glaeser, Fujii, Metrologia 45 (2008) 149, eq. 1 to 3 and annex),
    good to 22e-6 from 15 to 27 degC and 600 to 1100 hPa, and far better than thrust is measured
    outside of that.
    """
    t, p = temperature_degC, pressure_Pa
    kelvin = t + 273.15
    saturation_Pa = exp(
        1.2378847e-5 * kelvin**2 - 1.9121316e-2 * kelvin + 33.93711047 - 6.3431645e3 / kelvin
    )
    enhancement = 1.00062 + 3.14e-8 * p + 5.6e-7 * t**2
    x = humidity * enhancement * saturation_Pa / p
    compressibility = (
        1.0
        - (p / kelvin)
        * (
            (1.58123e-6 - 2.9331e-8 * t + 1.1043e-10 * t**2)
            + (5.707e-6 - 2.051e-8 * t) * x
            + (1.9898e-4 - 2.376e-6 * t) * x**2
        )
        + (p / kelvin) ** 2 * (1.83e-11 - 0.765e-8 * x**2)
    )
    molar = 3.483740e-3 + 1.4446e-3 * (CARBON_DIOXIDE - 0.0004)
    return molar * p / (compressibility * kelvin) * (1.0 - 0.3780 * x)
