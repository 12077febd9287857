"""The way of one move in machine positions: who is on it, and who has arrived. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

BESIDE_MM = 0.5
"""A report this far outside of start to target is off the way. A choice: far above a step and the
rounding of reports, far below what is dangerous at the least gap of any rig."""

ARRIVED_MM = 0.02
"""Positions this close are one: two steps of a common drive with 100 per mm."""


@dataclass(frozen=True, slots=True)
class GrblAxis:
    """Relate one axis of the stage to the plate.

    Attributes:
        letter: axis of the stage, in G-code.
        zero_m: plate coordinate (distance, or lateral position) at machine position 0.
        direction: +1 when the coordinate grows with machine position, -1 when it falls.
    """

    letter: str
    zero_m: float
    direction: int = 1

    def to_mm(self, coordinate_m: float) -> float:
        """Return the machine position of a plate coordinate."""
        return self.direction * 1e3 * (coordinate_m - self.zero_m)

    def to_m(self, position_mm: float) -> float:
        """Return the plate coordinate of a machine position."""
        return self.zero_m + self.direction * 1e-3 * position_mm


@dataclass(frozen=True, slots=True)
class Way:
    """Hold where a move begins and ends, by axis letter: mm.

    Attributes:
        steps_mm: length of one step of each axis; a stage stands half of it off at most.
    """

    start_mm: Mapping[str, float]
    target_mm: Mapping[str, float]
    steps_mm: Mapping[str, float]

    @property
    def length_mm(self) -> float:
        """Sum over axes, which is no shorter than the way."""
        return sum(abs(mm - self.start_mm[axis]) for axis, mm in self.target_mm.items())

    def left_at(self, place_mm: Mapping[str, float]) -> str:
        """Return what is wrong with a place that is not on the way; empty when it is."""
        for axis, target_mm in self.target_mm.items():
            low_mm, high_mm = sorted((self.start_mm[axis], target_mm))
            if not low_mm - BESIDE_MM <= place_mm[axis] <= high_mm + BESIDE_MM:
                return (
                    f"{axis} {place_mm[axis]:.3f} mm, outside {self.start_mm[axis]:.3f} to "
                    f"{target_mm:.3f} mm"
                )
        return ""

    def missed_at(self, place_mm: Mapping[str, float]) -> str:
        """Return how a place differs from the target; empty when it is the target."""
        for axis, target_mm in self.target_mm.items():
            allowed_mm = ARRIVED_MM + 0.5 * self.steps_mm[axis]
            if abs(place_mm[axis] - target_mm) > allowed_mm:
                return f"{axis} {place_mm[axis]:.3f} mm instead of {target_mm:.3f} mm"
        return ""
