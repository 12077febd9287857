"""Ambient air and the density of moist air."""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, sqrt
from typing import Annotated, Any

from annotated_types import Ge, Le

from benchtool.core.inputs import Input, Inputs

STANDARD_DEGC, STANDARD_PA = 15.0, 101_325.0
STANDARD_DENSITY_KG_M3 = 1.225  # of dry air at those (ISO 2533)


@dataclass(frozen=True, slots=True, kw_only=True)
class Air(Inputs):
    """Ambient conditions; default: standard dry air. The ranges are assumed, for any laboratory."""

    TITLE = "Air"

    temperature: Annotated[
        Annotated[float, Ge(-40.0), Le(60.0)] | None,
        Input(
            "Air temperature.", "degC", label="Air, degC", default_text=f"{STANDARD_DEGC:g} assumed"
        ),
    ] = None
    pressure: Annotated[
        Annotated[float, Ge(500.0), Le(1100.0)] | None,
        Input(
            "Local air pressure, not reduced to sea level.",
            "hPa",
            label="Pressure here, hPa",
            default_text=f"{0.01 * STANDARD_PA:g} assumed",
        ),
    ] = None
    humidity: Annotated[
        Annotated[float, Ge(0.0), Le(100.0)] | None,
        Input("Relative humidity.", "percent", label="Humidity, %", default_text="0 assumed"),
    ] = None

    def facts(self) -> dict[str, Any]:
        """Return the conditions for metadata.json, in SI units, with the density."""
        degC = STANDARD_DEGC if self.temperature is None else self.temperature
        pressure_Pa = STANDARD_PA if self.pressure is None else 100.0 * self.pressure
        humidity = 0.01 * (self.humidity or 0.0)
        return {
            "temperature_degC": degC,
            "pressure_Pa": pressure_Pa,
            "humidity": humidity,
            "density_kg_m3": air_density_kg_m3(degC, pressure_Pa, humidity),
            "measured": self.temperature is not None and self.pressure is not None,
            "formula": "CIPM-2007",
        }


def relative_density_sd(temperature_degC: float, pressure_Pa: float, humidity: float) -> float:
    """Return the relative standard uncertainty of the air density for typical instruments.

    Uniform within 1 K (room thermometer), 2 hPa (barometer or weather station) and 20 % relative
    humidity; assumed.
    """
    here = temperature_degC, pressure_Pa, humidity
    density = air_density_kg_m3(*here)
    off = [
        air_density_kg_m3(*(x + by for x, by in zip(here, step, strict=True))) / density - 1.0
        for step in ((1.0, 0.0, 0.0), (0.0, 200.0, 0.0), (0.0, 0.0, 0.2))
    ]
    return sqrt(sum(part**2 for part in off) / 3.0)


def air_density_kg_m3(temperature_degC: float, pressure_Pa: float, humidity: float) -> float:
    """Return the density of moist air: kg/m3; humidity is relative, 0 to 1.

    CIPM-2007 (Picard, Davis, Glaeser, Fujii, Metrologia 45 (2008) 149, eq. 1 to 3 and annex) at
    its reference of 400 ppm carbon dioxide; relative uncertainty 22e-6 from 15 to 27 degC and 600
    to 1100 hPa, and outside of it still far below that of thrust.
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
    return 3.483740e-3 * p / (compressibility * kelvin) * (1.0 - 0.3780 * x)


def sound_speed_m_s(temperature_degC: float) -> float:
    """Return the speed of sound in dry air: sqrt(1.4 R T), R = 287.05287 J/(kg K) (ISO 2533)."""
    return sqrt(1.4 * 287.05287 * (temperature_degC + 273.15))


def viscosity_Pa_s(temperature_degC: float) -> float:
    """Return the viscosity of air by Sutherland's law (U.S. Standard Atmosphere 1976, eq. 51)."""
    kelvin = temperature_degC + 273.15
    return float(1.458e-6 * kelvin**1.5 / (kelvin + 110.4))
