"""Start the bench process, before the server's imports; import large frameworks quickly."""

from __future__ import annotations

import gc
import socket
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection as Pipe
from typing import Any, NamedTuple

UNUSED = ("aiohttp",)  # imported by the framework if installed, in 0.25 s


@contextmanager
def quick_import() -> Iterator[None]:
    """Import without what is not needed, and without garbage collection meanwhile.

    What was imported is never searched for garbage afterwards.
    """
    absent = [name for name in UNUSED if name not in sys.modules]
    # None in this table is Python's way to say that a module is not installed.
    sys.modules.update(dict.fromkeys(absent))  # type: ignore[arg-type]
    gc.disable()
    try:
        yield
    finally:
        for name in absent:
            del sys.modules[name]
        gc.freeze()
        gc.enable()


class StopEndpoint(NamedTuple):
    """Bound socket and token of the STOP listener."""

    listening: socket.socket
    token: str

    @property
    def port(self) -> int:
        """Return the port of the listener."""
        return int(self.listening.getsockname()[1])


class ProcessHandle:
    """Own the process and the pipe to it.

    Args:
        stop_endpoint: for its STOP listener; stays open here, for a process that follows.

    The process ends by itself when the pipe closes: it stops the motors and closes its run first.
    """

    def __init__(self, stop_endpoint: StopEndpoint | None = None) -> None:
        self.stop_endpoint = stop_endpoint
        self._process: Any = None
        self._pipe: Pipe | None = None
        self._sending = threading.Lock()

    @property
    def started(self) -> bool:
        return self._pipe is not None

    def start(self) -> None:
        spawn = get_context("spawn")
        self._pipe, theirs = spawn.Pipe()
        arguments = (theirs, *(self.stop_endpoint or ()))
        self._process = spawn.Process(target=_run, args=arguments, name="benchtool bench")
        self._process.start()
        theirs.close()

    def send(self, message: bytes) -> None:
        """Send a message; that the process is gone is noticed by `receive`."""
        if self._pipe is not None:
            with suppress(OSError), self._sending:
                self._pipe.send_bytes(message)

    def successor(self) -> ProcessHandle:
        """Return a handle for the process that follows one that has ended."""
        return ProcessHandle(self.stop_endpoint)

    def receive(self) -> bytes:
        """Wait for a message.

        Raises:
            EOFError: it has ended.
            OSError: the pipe was closed here.
        """
        if self._pipe is None:
            raise EOFError
        received: bytes = self._pipe.recv_bytes()
        return received

    def end(self, patience_s: float) -> None:
        """Wait so long for its end and close the pipe, which ends it; safe to call twice."""
        if self._pipe is not None:
            self._process.join(patience_s)
            self._pipe.close()
            self._pipe = None


def _run(pipe: Pipe, *stop_endpoint: Any) -> None:
    # A search for garbage among all that is imported would hold a Stop for tens of milliseconds.
    with quick_import():
        from benchtool.web.bench_process.process import run_bench_process
    run_bench_process(pipe, *stop_endpoint)
