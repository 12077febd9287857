"""What the RCbenchmark GUI would give for rows of simulated readings, pure."""

from __future__ import annotations

from math import isfinite
from typing import Any

from benchtool.bench.rcbenchmark.words import VIRTUAL_BOARD
from benchtool.core.units import from_si

VIRTUAL_1580 = f"{VIRTUAL_BOARD}, as Series 1580"

READINGS: dict[str, tuple[str, str]] = {
    "thrust_N": ("thrust", "gf"),
    "rpm1": ("motorOpticalSpeed", "RPM"),
    "voltage_V": ("voltage", "V"),
    "current_A": ("current", "A"),
    "plate_z_m": ("plateDistance", "m"),
}
"""Name and unit in the GUI of each channel; a plate is the virtual stand's own."""


class StandReadings:
    """Turn rows of a plant into the GUI's results.

    Every channel holds its last value, as the GUI shows it.

    Args:
        names: (c,) channels of a row.
        speed: stand seconds per wall second.
    """

    def __init__(self, names: tuple[str, ...], speed: float) -> None:
        self._names = names
        self._speed = speed
        self._held: dict[str, float] = {}

    def result(self, time_us: int, row: list[float], plate_moves: bool) -> dict[str, Any]:
        """Return the result of one reading, with working values and units only.

        Args:
            time_us: device time.
            row: (c,) in the channels' units, nan where a channel has no new value.
            plate_moves: whether the plate is on its way.
        """
        self._held |= {
            name: value for name, value in zip(self._names, row, strict=True) if isfinite(value)
        }
        result = {"time": _entry(1e-6 * time_us, "s")}
        for channel, (name, unit) in READINGS.items():
            if channel in self._held:
                value = self._held[channel]
                result[name] = _entry(from_si(value, unit) if unit == "gf" else value, unit)
        result["plateMoving"] = _entry(float(plate_moves), "")
        result["simulationSpeed"] = _entry(self._speed, "")
        return result


def _entry(value: float, unit: str) -> dict[str, Any]:
    return {"workingValue": value, "workingUnit": unit}
