"""An operator who presses Ctrl-C in the middle of a sweep."""

from __future__ import annotations

import signal
from contextlib import AbstractContextManager, nullcontext

from benchtool.acquire.operator import Unattended
from benchtool.acquire.record import RunProgress
from benchtool.data.run.points import Point


class Interrupting(RunProgress):
    """Raise the signal of Ctrl-C at the second point."""

    def measured(self, point: Point, remaining_s: float) -> None:
        if point.point == 2:
            signal.raise_signal(signal.SIGINT)


class Interrupted(Unattended):
    """Operator with that display."""

    def display(self, radius_m: float) -> AbstractContextManager[RunProgress]:
        return nullcontext(Interrupting())
