"""Signals that end a run: deferred while it goes on, ignored for a while as it is closed."""

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

SIGNAL_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")  # Ctrl-C, end, hangup, Ctrl-Break

_WORDS = {
    "SIGINT": "stopped by Ctrl-C",
    "SIGBREAK": "stopped by Ctrl-Break",
    "SIGHUP": "stopped because the terminal was closed",
}


class _Handlers:
    """Hold the handlers of signals that were there before ours."""

    def __init__(self) -> None:
        self._before: dict[signal.Signals, Any] = {}

    def _take_over(self, handle: Callable[[int, FrameType | None], None]) -> None:
        """Install a handler in the main thread; signals that were ignored stay so (nohup)."""
        if threading.current_thread() is not threading.main_thread():
            return
        for name in SIGNAL_NAMES:
            number = getattr(signal, name, None)
            if number is None or signal.getsignal(number) in (signal.SIG_IGN, None):
                continue
            self._before[number] = signal.signal(number, handle)

    def restore(self) -> None:
        """Give the signals back to whoever had them."""
        while self._before:
            number, handler = self._before.popitem()
            signal.signal(number, handler)


class StopSignals(_Handlers):
    """Be the scope, from `install` to `restore`, in which signals are deferred.

    A signal is only noted, and raised by the next `raise_if_requested`: it comes neither between a
    sample and the disk nor into a stop. Within `interruptible` it is raised at once: for waits
    that call nothing else for long. Each scope raises at most one signal at once.

    Outside of the main thread Python allows no handlers; there only exceptions end a run.

    Args:
        note: gets the reason at once, in case somebody catches the error.
    """

    def __init__(self, note: Callable[[str], None]) -> None:
        super().__init__()
        self._note = note
        self._requested: str | None = None
        self._raises = False

    def install(self) -> None:
        if threading.current_thread() is threading.main_thread():
            self._requested, self._raises = None, False
        self._take_over(self._handle)

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """Let a signal raise at once within this inner scope, one that was noted on entering it."""
        self.raise_if_requested()
        self._raises = True
        try:
            self.raise_if_requested()
            yield
        finally:
            self._raises = False

    def request(self, reason: str) -> None:
        """Request the end of the run as a signal does, from any thread."""
        self._requested = self._requested or reason
        self._note(self._requested)

    def raise_if_requested(self) -> None:
        """Raise what a signal has noted, again and again should somebody swallow it."""
        if self._requested is not None:
            raise RunInterrupted(f"{self._requested}; zero was commanded to the motors")

    def _handle(self, number: int, frame: FrameType | None) -> None:
        name = signal.Signals(number).name
        again = self._requested is not None
        self.request(_WORDS.get(name, f"stopped by {name}"))
        if self._raises and not again:
            self._raises = False
            self.raise_if_requested()


SHUTDOWN_TIMEOUT_S = 10.0  # from the first ignored signal until the next ends the program; assumed


class ClosingSignals(_Handlers):
    """Prevent impatient signals from cutting the closing of a run short.

    Entered before the bench is guarded; a guard's own handlers act while it is there. Until `begin`
    signals mean what they meant before, after it they are ignored.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self._clock = clock
        self._begun = False
        self._first_s: float | None = None

    def begin(self) -> None:
        """Say that there is a run now, which is to be closed whatever happens."""
        self._begun = True

    def __enter__(self) -> Self:
        self._take_over(self._handle)
        return self

    def __exit__(self, *_: object) -> None:
        self.restore()

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
                f"benchtool: the run is being closed; Ctrl-C once more after "
                f"{SHUTDOWN_TIMEOUT_S:g} s "
                f"leaves it as it is\n".encode(),
            )
        elif now_s - self._first_s >= SHUTDOWN_TIMEOUT_S:
            raise KeyboardInterrupt
