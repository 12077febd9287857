"""The seam to whoever watches a sweep: a terminal, a web page, a test."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from benchtool.acquire.order import Visit
from benchtool.data.run.append import Event
from benchtool.data.run.points import Point


class RunProgress:
    """Receive what a run does, and do nothing with it; displays override what they show.

    Calls come from the run's own thread and must return quickly.
    """

    def started(self, visits: int, done: int, expected_s: float) -> None:
        """Receive that a sweep of so many visits begins, some of them done already."""

    def visiting(self, visit: Visit) -> None:
        """Receive that a visit begins."""

    def measured(self, point: Point, remaining_s: float) -> None:
        """Receive a point that is on the disk, and the time that is left."""

    def happened(self, event: Event) -> None:
        """Receive an event that is on the disk."""


class SafeProgress(RunProgress):
    """Forward to another progress until it fails (a closed pipe, a terminal that went).

    A run continues when nobody looks; what it measures is on the disk.
    """

    def __init__(self, watcher: RunProgress | None) -> None:
        self._watcher = watcher or RunProgress()

    def _forward(self, method: Callable[..., None], *arguments: Any) -> None:
        try:
            method(*arguments)
        except OSError:
            self._watcher = RunProgress()

    def started(self, visits: int, done: int, expected_s: float) -> None:
        self._forward(self._watcher.started, visits, done, expected_s)

    def visiting(self, visit: Visit) -> None:
        self._forward(self._watcher.visiting, visit)

    def measured(self, point: Point, remaining_s: float) -> None:
        self._forward(self._watcher.measured, point, remaining_s)

    def happened(self, event: Event) -> None:
        self._forward(self._watcher.happened, event)
