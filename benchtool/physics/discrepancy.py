"""How far laws and sensors may be off before it matters, where no effect has a tolerance for it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite

from benchtool.core.errors import InputError
from benchtool.physics.effects.effect import BenchKind

_PITCH_ONLY = ("torque", "encoder_rad", "gyro")
_SWEEP_ONLY = ("speed_by_plate", "voltage")


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscrepancyTolerances:
    """Hold the departures from every law and effect that do not matter; `[discrepancy]` of a model.

    Attributes:
        thrust: of thrust, over it.
        speed: of rotor speed at a pulse, over it.
        speed_by_plate: the same by the plate of a sweep: where the ESC sets a voltage, speed at a
            pulse changes with the blades' torque, by half a per cent at z/R 0.5 (blade-element
            momentum theory).
        voltage: of a battery's voltage, over it: none empties along the curve of another.
        torque: of the torque on the hinge, over thrust times arm.
        encoder_rad: of an encoder's reading; two tenths of a degree, as data sheets of magnetic
            ones state.
        gyro: of a gyro's reading, over the standard deviation of what it reads.
        law: standard deviation of an effect's own law, over what the effect does.
    """

    thrust: float = 0.005
    speed: float = 0.001
    speed_by_plate: float = 0.01
    voltage: float = 0.005
    torque: float = 0.001
    encoder_rad: float = 0.0035
    gyro: float = 0.01
    law: float = 0.1

    def shown_by(self, bench: BenchKind) -> dict[str, float]:
        """Return those that count on a bench, by name."""
        other = {"sweep": _PITCH_ONLY, "pitch": _SWEEP_ONLY}[bench]
        return {
            item.name: getattr(self, item.name) for item in fields(self) if item.name not in other
        }

    def __post_init__(self) -> None:
        for item in fields(self):
            value = getattr(self, item.name)
            if not (isfinite(value) and 0.0 < value <= 1.0):
                raise InputError(
                    f"the discrepancy {item.name} is {value:g}; give a number above 0 and up to 1"
                )
