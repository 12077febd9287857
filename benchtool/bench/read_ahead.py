"""Samples that come before anybody reads: kept for the next read, told to a listener at once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

from benchtool.bench.bench import Readings
from benchtool.bench.join_readings import joined

Listener = Callable[[Readings], None]
"""Is given every block of samples once, in order; it must return quickly and never raise."""


@runtime_checkable
class Overheard(Protocol):
    """Let somebody hear the samples as they come, whatever call waits for the device."""

    def overhear(self, listener: Listener) -> None:
        """Tell a listener of every block from now on, before it is handed out by `read`.

        The listener is called in the thread that owns the bench.
        """
        ...


class ReadAhead:
    """Keep blocks of samples until they are read."""

    def __init__(self) -> None:
        self._kept: list[Readings] = []
        self._listener: Listener | None = None

    def overhear(self, listener: Listener) -> None:
        """Tell a listener of every block from now on."""
        self._listener = listener

    def told(self, readings: Readings) -> Readings:
        """Return a block that is handed out at once, after the listener has heard of it."""
        if self._listener is not None:
            self._listener(readings)
        return readings

    def keep(self, readings: Readings) -> None:
        """Keep a block for the next read; the listener hears of it now."""
        self._kept.append(self.told(readings))

    def read(self, fresh: Callable[[], Readings]) -> Readings:
        """Return what was kept, or else a fresh block; what was kept without samples goes along."""
        kept = self.take()
        if kept is not None and len(kept):
            return kept
        new = self.told(fresh())
        return new if kept is None else joined([kept, new])

    def take(self) -> Readings | None:
        """Return what was kept, in one block; None where nothing was."""
        kept, self._kept = self._kept, []
        return joined(kept) if kept else None
