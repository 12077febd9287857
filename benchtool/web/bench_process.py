"""The bench process as the server holds it. Light: it is started before the server's imports."""

from __future__ import annotations

from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection as Pipe
from typing import Any

from benchtool.web.quick_import import quick_import


class BenchProcess:
    """Own the process and the pipe to it.

    The process ends by itself when the pipe closes: it stops the motors and closes its run first.
    """

    def __init__(self) -> None:
        self._process: Any = None
        self._pipe: Pipe | None = None

    @property
    def started(self) -> bool:
        """Whether there is a pipe to talk through."""
        return self._pipe is not None

    def start(self) -> None:
        """Start it."""
        spawn = get_context("spawn")
        self._pipe, theirs = spawn.Pipe()
        self._process = spawn.Process(target=_hold, args=(theirs,), name="benchtool bench")
        self._process.start()
        theirs.close()

    def send(self, told: bytes) -> None:
        """Tell it something; one that is gone is heard of where it is listened to."""
        if self._pipe is not None:
            with suppress(OSError):
                self._pipe.send_bytes(told)

    def receive(self) -> bytes:
        """Wait for what it tells.

        Raises:
            EOFError: it has ended.
            OSError: the pipe was closed here.
        """
        if self._pipe is None:
            raise EOFError
        return self._pipe.recv_bytes()

    def end(self, patience_s: float) -> None:
        """Wait so long for its end and close the pipe, which ends it; safe to call twice."""
        if self._pipe is not None:
            self._process.join(patience_s)
            self._pipe.close()
            self._pipe = None


def _hold(pipe: Pipe) -> None:
    # A search for garbage among all that is imported would hold a Stop for tens of milliseconds.
    with quick_import():
        from benchtool.web.desk.desk import run_desk
    run_desk(pipe)
