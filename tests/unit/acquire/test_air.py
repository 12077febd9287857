from __future__ import annotations

import pytest

from benchtool.acquire.air import Air, air_density_kg_m3
from benchtool.core.errors import InputError


@pytest.mark.parametrize(
    ("temperature_degC", "pressure_Pa", "humidity", "density"),
    [
        # Standard atmosphere (ISO 2533): 1.2250 for an ideal dry gas.
        (15.0, 101_325.0, 0.0, 1.2250),
        # Ideal mixture by hand: (p - 0.378 e)/(287.05 T), e = 0.5 * 2339 Pa (steam tables).
        (20.0, 101_325.0, 0.5, (101_325.0 - 0.378 * 0.5 * 2339.0) / (287.05 * 293.15)),
        (25.0, 95_000.0, 0.8, (95_000.0 - 0.378 * 0.8 * 3169.0) / (287.05 * 298.15)),
    ],
)
def test_density_of_moist_air(
    temperature_degC: float, pressure_Pa: float, humidity: float, density: float
) -> None:
    found = air_density_kg_m3(temperature_degC, pressure_Pa, humidity)
    # A real gas is denser than the ideal one by about 4e-4 here.
    assert found == pytest.approx(density, rel=8e-4)


@pytest.mark.parametrize(
    "wrong", [{"temperature": 300.0}, {"pressure": 101325.0}, {"humidity": 145.0}]
)
def test_other_units_are_noticed(wrong: dict[str, float]) -> None:
    with pytest.raises(InputError, match="allowed is"):
        Air(**wrong)
