"""A channel: one named column of a recording or of a bench's stream."""

from __future__ import annotations

from dataclasses import dataclass

from benchtool.core.units import unit_named


@dataclass(frozen=True, slots=True)
class Channel:
    """Name one measured or commanded quantity.

    Attributes:
        name: identifier whose suffix is the unit as it stands in files (`thrust_N`, `pwm1_us`).
            Rotor speed in revolutions per minute is the one habit of the field that files keep:
            `rpm1`, unit "rpm".
        unit: unit of the stored numbers, one of `core.units.UNITS`.
        description: one line for people.
    """

    name: str
    unit: str
    description: str = ""

    def __post_init__(self) -> None:
        unit_named(self.unit)
