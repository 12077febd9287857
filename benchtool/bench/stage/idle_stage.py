"""A separate stage moves at idle throttle only, and its word is compared with the reading."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from benchtool.bench.stage.stage import Pause, Stage


class PlateGuard(Protocol):
    """Be asked before a move and after it (`GuardedBench`)."""

    def ready_for_move(self, z_m: float, x_m: float = 0.0, tilt_rad: float = 0.0) -> None:
        """Raise when the plate must stay."""
        ...

    def confirm_plate(self, target_m: float, stage_m: float, more_m: float = 0.0) -> None:
        """Raise when the bench reads another position than the stage says."""
        ...


class IdleStage:
    """Be another stage that asks first whether the plate may move, and then whether it did.

    Args:
        stage: moves the plate by itself, without the bench knowing.
        guard: of the bench.
    """

    def __init__(self, stage: Stage, guard: PlateGuard) -> None:
        self._stage = stage
        self._guard = guard

    @property
    def facts(self) -> Mapping[str, str | float]:
        return self._stage.facts

    @property
    def measures_to_m(self) -> float:
        return self._stage.measures_to_m

    def open(self) -> None:
        self._stage.open()

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        self._guard.ready_for_move(z_m, x_m, tilt_rad)
        reached_m = self._stage.move(z_m, x_m, tilt_rad, pause)
        self._guard.confirm_plate(z_m, reached_m, self._stage.measures_to_m)
        return reached_m

    def hold(self) -> None:
        self._stage.hold()

    def close(self) -> None:
        self._stage.close()
