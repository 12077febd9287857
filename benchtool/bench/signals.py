"""Signal handlers for runs. Signals are deferred during a run and ignored while it is closed."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Any, Self

from benchtool.core.errors import RunInterrupted

# Ctrl-C, termination request, closed terminal, Ctrl-Break (Windows); skipped where not defined.
SIGNAL_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
SHUTDOWN_TIMEOUT_S = 10.0  # signals are ignored for so long; closing takes about 1 s; assumed

_STOP_REASONS = {
    "SIGINT": "stopped by Ctrl-C",
    "SIGBREAK": "stopped by Ctrl-Break",
    "SIGHUP": "stopped because the terminal was closed",
}


class _SignalHandlers:
    """Base class that installs signal handlers and restores the previous ones."""

    def __init__(self) -> None:
        self._previous: dict[signal.Signals, Any] = {}

    def _install_handlers(self, new_handler: Callable[[int, FrameType | None], None]) -> None:
        """Install a handler in the main thread; ignored signals stay ignored (nohup)."""
        if threading.current_thread() is not threading.main_thread():
            return
        for name in SIGNAL_NAMES:
            number = getattr(signal, name, None)
            if number is None or signal.getsignal(number) in (signal.SIG_IGN, None):
                continue
            self._previous[number] = signal.signal(number, new_handler)

    def restore(self) -> None:
        """Restore the previous signal handlers."""
        while self._previous:
            number, handler = self._previous.popitem()
            signal.signal(number, handler)


class StopSignals(_SignalHandlers):
    """Scope that defers signals, from `install` to `restore`.

    A deferred signal is raised by the next `raise_if_requested`. It interrupts neither the writing
    of a sample nor a stop command. Inside `interruptible` a signal raises immediately; use it for
    long blocking waits. After the first signal, later ones never raise immediately.

    Python allows signal handlers in the main thread only. Elsewhere only exceptions end a run.

    Args:
        note: callback that receives the reason immediately, even if the error is caught later.
    """

    def __init__(self, note: Callable[[str], None]) -> None:
        super().__init__()
        self._note = note
        self._stop_reason: str | None = None
        self._raises_immediately = False

    def install(self) -> None:
        if threading.current_thread() is threading.main_thread():
            self._stop_reason, self._raises_immediately = None, False
        self._install_handlers(self._handle)

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """Raise signals immediately inside this context; raise a deferred signal on entry."""
        self.raise_if_requested()
        self._raises_immediately = True
        try:
            self.raise_if_requested()
            yield
        finally:
            self._raises_immediately = False

    def request(self, reason: str) -> None:
        """Record a reason to stop, from any thread; only the first one counts."""
        self._stop_reason = self._stop_reason or reason
        self._note(self._stop_reason)

    def raise_if_requested(self) -> None:
        """Raise RunInterrupted if a signal was received; every later call raises it again."""
        if self._stop_reason is not None:
            raise RunInterrupted(f"{self._stop_reason}; zero was commanded to the motors")

    def _handle(self, number: int, frame: FrameType | None) -> None:
        name = signal.Signals(number).name
        is_repeated = self._stop_reason is not None
        self.request(_STOP_REASONS.get(name, f"stopped by {name}"))
        if self._raises_immediately and not is_repeated:
            self._raises_immediately = False
            self.raise_if_requested()


class ClosingSignals(_SignalHandlers):
    """Context manager that ignores signals while a run is closed.

    Enter it before the guarded bench, whose own handlers replace these while it is open. Before
    `ignore_signals` the previous handlers are called, then signals are ignored; one that arrives
    `SHUTDOWN_TIMEOUT_S` or more after the first ignored signal raises KeyboardInterrupt.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._ignores_signals = False
        self._first_signal_s: float | None = None

    def ignore_signals(self) -> None:
        """Ignore signals from now on, until the run is closed."""
        self._ignores_signals = True

    def __enter__(self) -> Self:
        self._install_handlers(self._handle)
        return self

    def __exit__(self, *_: object) -> None:
        self.restore()

    def _handle(self, number: int, frame: FrameType | None) -> None:
        if not self._ignores_signals:
            previous = self._previous[signal.Signals(number)]
            if callable(previous):
                previous(number, frame)
            else:
                signal.signal(number, previous)
                signal.raise_signal(number)
            return
        now_s = self._clock()
        if self._first_signal_s is None:
            self._first_signal_s = now_s
            # os.write, because the handler may interrupt a print.
            os.write(
                2,
                f"benchtool: the run is being closed; to exit without closing it, press Ctrl-C "
                f"again after {SHUTDOWN_TIMEOUT_S:g} s\n".encode(),
            )
        elif now_s - self._first_signal_s >= SHUTDOWN_TIMEOUT_S:
            raise KeyboardInterrupt
