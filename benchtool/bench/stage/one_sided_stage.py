"""Reach every plate distance from farther away, so that play in the drive has one sign."""

from __future__ import annotations

from collections.abc import Mapping

from benchtool.bench.stage.stage import Pause, Stage
from benchtool.core.rig import PlateStage

OVERSHOOT_BACKLASHES = 5.0
"""How far to go past a distance that is approached from nearer, in backlashes; a choice."""


class OneSidedStage:
    """Be another stage that overshoots when it moves away, and comes back.

    Without it a distance stands nearer or farther by the play, as the last move happened to go: a
    scatter that grows towards the plate and pulls R and K_b apart. With it the play is a constant,
    which a plate offset takes up.

    Args:
        stage: moves the plate by itself (no operator).
        plate: play and travel.
    """

    def __init__(self, stage: Stage, plate: PlateStage) -> None:
        self._stage = stage
        self._overshoot_m = OVERSHOOT_BACKLASHES * plate.backlash_m
        self._farthest_m = plate.z_max_m
        self._standing_m: float | None = None

    @property
    def facts(self) -> Mapping[str, str | float]:
        return self._stage.facts

    @property
    def measures_to_m(self) -> float:
        return self._stage.measures_to_m

    def open(self) -> None:
        self._stage.open()

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        away = self._standing_m is None or z_m > self._standing_m
        past_m = min(z_m + self._overshoot_m, self._farthest_m)
        if away and past_m > z_m:
            self._stage.move(past_m, x_m, tilt_rad, pause)
        reached_m = self._stage.move(z_m, x_m, tilt_rad, pause)
        self._standing_m = z_m
        return reached_m

    def hold(self) -> None:
        self._standing_m = None
        self._stage.hold()

    def close(self) -> None:
        self._stage.close()
