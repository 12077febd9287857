"""Signals that end a run, turned into an error at the place where the program is."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterable
from operator import attrgetter
from types import FrameType
from typing import Any

from benchtool.errors import RunStopped

SIGNAL_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
"""Ctrl-C, a request to end, a closed terminal, and Ctrl-Break on Windows; each where it exists."""

_WORDS = {
    "SIGINT": "stopped by Ctrl-C",
    "SIGBREAK": "stopped by Ctrl-Break",
    "SIGHUP": "stopped because the terminal was closed",
}


class StopSignals:
    """Hold the handlers of signals for as long as motors may turn.

    Outside of the main thread Python allows no handlers; there only exceptions end a run.

    Args:
        note: is told the reason at once, in case somebody catches the error.
        undisturbed: while one of these functions runs, a signal is only noted.
    """

    def __init__(
        self, note: Callable[[str], None], undisturbed: Iterable[Callable[..., object]] = ()
    ) -> None:
        self._note = note
        self._undisturbed = set(map(attrgetter("__code__"), undisturbed))
        self._before: dict[signal.Signals, Any] = {}
        self._asked: str | None = None

    def spare(self, *functions: Callable[..., object]) -> None:
        """Let signals only be noted while these run, too; `raise_if_asked` raises them later."""
        self._undisturbed.update(map(attrgetter("__code__"), functions))

    def install(self) -> None:
        """Take the signals over; those that were ignored stay so (nohup)."""
        if threading.current_thread() is not threading.main_thread():
            return
        self._asked = None
        for name in SIGNAL_NAMES:
            number = getattr(signal, name, None)
            if number is None or signal.getsignal(number) in (signal.SIG_IGN, None):
                continue
            self._before[number] = signal.signal(number, self._handle)

    def restore(self) -> None:
        """Give the signals back to whoever had them."""
        while self._before:
            number, handler = self._before.popitem()
            signal.signal(number, handler)

    def raise_if_asked(self) -> None:
        """Raise again what a signal has raised before, should somebody have swallowed it."""
        if self._asked is not None:
            raise RunStopped(f"{self._asked}; zero was commanded to the motors")

    def _handle(self, number: int, frame: FrameType | None) -> None:
        name = signal.Signals(number).name
        again = self._asked is not None
        self._asked = self._asked or _WORDS.get(name, f"stopped by {name}")
        self._note(self._asked)
        while frame is not None:
            if frame.f_code in self._undisturbed:
                return
            frame = frame.f_back
        if not again:
            raise RunStopped(f"{self._asked}; zero was commanded to the motors")
