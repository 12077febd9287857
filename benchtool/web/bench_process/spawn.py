"""Start of the bench process before the server's imports, and quick import of large frameworks."""

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

UNUSED_MODULES = ("aiohttp", "requests", "tornado")  # imported by the framework if installed


@contextmanager
def quick_import() -> Iterator[None]:
    """Context manager for imports without unused modules and garbage collection.

    Imported objects are excluded from later garbage collections.
    """
    absent = [name for name in UNUSED_MODULES if name not in sys.modules]
    # None in sys.modules marks a module as not installed.
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
        return int(self.listening.getsockname()[1])


class ProcessHandle:
    """Bench process and the pipe to it.

    When the pipe closes, the process stops the motors, closes its run and ends. The endpoint of
    its STOP listener stays open for a replacement process.
    """

    def __init__(self, stop_endpoint: StopEndpoint | None = None) -> None:
        self.stop_endpoint = stop_endpoint
        self._process: Any = None
        self._pipe: Pipe | None = None
        self._sending = threading.Lock()

    def start(self) -> None:
        """Start the process unless it is started."""
        if self._pipe is not None:
            return
        spawn = get_context("spawn")
        self._pipe, child_pipe = spawn.Pipe()
        arguments = (child_pipe, *(self.stop_endpoint or ()))
        self._process = spawn.Process(target=_run, args=arguments, name="benchtool bench")
        self._process.start()
        child_pipe.close()

    def send(self, message: bytes) -> None:
        """Send a message; `receive` detects that the process has ended."""
        if self._pipe is not None:
            with suppress(OSError), self._sending:
                self._pipe.send_bytes(message)

    def receive(self) -> bytes:
        """Return the next message; raise `EOFError` or `OSError` if the process has ended."""
        if self._pipe is None:
            raise EOFError
        message: bytes = self._pipe.recv_bytes()
        return message

    def end(self, timeout_s: float) -> None:
        """Wait up to a timeout for the process to end, then close the pipe; idempotent."""
        if self._pipe is not None:
            self._process.join(timeout_s)
            self._pipe.close()
            self._pipe = None


def _run(pipe: Pipe, *stop_endpoint: Any) -> None:
    # A garbage collection over all imported objects would delay a STOP by tens of milliseconds.
    with quick_import():
        from benchtool.web.bench_process.process import run_bench_process
    run_bench_process(pipe, *stop_endpoint)
