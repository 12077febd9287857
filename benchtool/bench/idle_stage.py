"""Ask the bench before a separate stage moves: at idle throttle only, never inside the gap."""

from __future__ import annotations

from collections.abc import Callable

from benchtool.bench.stage import Pause, Stage


class IdleStage:
    """Be another stage that asks first whether the plate may move.

    Args:
        stage: moves the plate by itself, without the bench knowing.
        ready: ready(z_m, x_m, tilt_rad) raises when the plate must stay
            (`GuardedBench.ready_for_move`).
    """

    def __init__(self, stage: Stage, ready: Callable[[float, float, float], None]) -> None:
        self._stage = stage
        self._ready = ready

    def open(self) -> None:
        self._stage.open()

    def move(self, z_m: float, x_m: float, tilt_rad: float, pause: Pause) -> float:
        self._ready(z_m, x_m, tilt_rad)
        return self._stage.move(z_m, x_m, tilt_rad, pause)

    def hold(self) -> None:
        self._stage.hold()

    def close(self) -> None:
        self._stage.close()
