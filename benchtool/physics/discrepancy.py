"""Tolerances of model discrepancies: errors of laws and sensors beyond those of effects."""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import isfinite

from benchtool.core.errors import InputError
from benchtool.physics.effects.effect import BenchKind

_PITCH_ONLY = ("torque", "encoder_rad", "gyro")
_SWEEP_ONLY = ("speed_by_plate", "voltage")


@dataclass(frozen=True, slots=True, kw_only=True)
class DiscrepancyTolerances:
    """Tolerated deviations from all laws and effects; table `[discrepancy]` of a model file."""

    thrust: float = 0.005  # relative error of thrust
    speed: float = 0.001  # relative error of rotor speed at a pulse width
    # The same, depending on the plate of a sweep: with an ESC that sets a voltage, the blades'
    # torque changes the speed by half a per cent at z/R 0.5 (blade-element momentum theory)
    speed_by_plate: float = 0.01
    voltage: float = 0.005  # relative error of a battery's voltage; discharge curves differ
    torque: float = 0.001  # error of the hinge torque over thrust times arm
    # Error of an encoder's reading; 0.2 degrees from data sheets of magnetic ones
    encoder_rad: float = 0.0035
    gyro: float = 0.01  # error of a gyro's reading over the standard deviation of its signal
    law: float = 0.1  # standard deviation of an effect's law over the contribution of the effect

    def relevant_on(self, bench: BenchKind) -> dict[str, float]:
        """Return the tolerances that apply to a kind of bench, by name."""
        excluded = {"sweep": _PITCH_ONLY, "pitch": _SWEEP_ONLY}[bench]
        names = (field.name for field in fields(self) if field.name not in excluded)
        return {name: getattr(self, name) for name in names}

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not (isfinite(value) and 0.0 < value <= 1.0):
                raise InputError(
                    f"discrepancy {field.name} = {value:g} is out of range; allowed: above 0, at "
                    f"most 1"
                )
