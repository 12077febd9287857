"""Signals while a run is being closed: heard, told once, and otherwise ignored for a while."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any, Self

from benchtool.bench.transport.stop_signals import SIGNAL_NAMES

PATIENCE_S = 10.0
"""After so long since the first ignored signal the next one ends the program; a choice: closing a
run of hours takes about a second."""


class ClosingSignals:
    """Keep impatient signals from cutting the closing of a run short.

    Entered before the bench is guarded; a guard's own handlers act while it is there. Until `begin`
    signals mean what they meant before, after it they are ignored.

    Args:
        clock: monotonic, in seconds.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._before: dict[signal.Signals, Any] = {}
        self._begun = False
        self._first_s: float | None = None

    def begin(self) -> None:
        """Say that there is a run now, which is to be closed whatever happens."""
        self._begun = True

    def __enter__(self) -> Self:
        if threading.current_thread() is threading.main_thread():
            for name in SIGNAL_NAMES:
                number = getattr(signal, name, None)
                if number is None or signal.getsignal(number) in (signal.SIG_IGN, None):
                    continue
                self._before[number] = signal.signal(number, self._handle)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        while self._before:
            number, handler = self._before.popitem()
            signal.signal(number, handler)

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if not self._begun:
            before = self._before[signal.Signals(number)]
            if callable(before):
                before(number, frame)
            else:
                signal.signal(number, before)
                signal.raise_signal(number)
            return
        now_s = self._clock()
        if self._first_s is None:
            self._first_s = now_s
            # Not print: a handler may interrupt a print of the program.
            os.write(
                2,
                f"benchtool: the run is being closed; Ctrl-C once more after {PATIENCE_S:g} s "
                f"leaves it as it is\n".encode(),
            )
        elif now_s - self._first_s >= PATIENCE_S:
            raise KeyboardInterrupt
