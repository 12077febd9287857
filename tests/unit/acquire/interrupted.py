"""An operator who presses Ctrl-C in the middle of a sweep."""

from __future__ import annotations

import signal
from contextlib import AbstractContextManager, nullcontext

from benchtool.acquire.operator import Unattended
from benchtool.acquire.record import RunProgress
from benchtool.data.run.points import Point


class Interrupted(Unattended):
    """Raise the signal of Ctrl-C at the second point."""

    def display(self, radius_m: float) -> AbstractContextManager[RunProgress]:
        class Display(RunProgress):
            def measured(self, point: Point, remaining_s: float) -> None:
                if point.point == 2:
                    signal.raise_signal(signal.SIGINT)

        return nullcontext(Display())
