"""Work that takes processor time, in a process of its own: the page stays quick, Stop too.

A job is a function at the top of a module; what it returns is the result. Jobs are short and follow
each other in one process, which has its libraries loaded. What takes minutes, says how far it is
and outlives the page that began it is a `Job`, in a process for itself.
"""

from __future__ import annotations

import asyncio
import signal
import sys
import traceback
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from typing import Any

from benchtool.errors import BenchtoolError, RunStopped
from benchtool.web.job import fault_sentence


class Worker:
    """Run jobs one after another in one process, started with the first of them.

    Args:
        name: what it works for, as messages call it.
    """

    def __init__(self, name: str) -> None:
        self._name = name
        self._turn = asyncio.Lock()
        self._process: Any = None
        self._pipe: Connection | None = None

    async def run(self, job: Callable[..., Any], *args: Any) -> Any:
        """Return what a job returns.

        Raises:
            BenchtoolError: what the job raised, with the same sentence.
            RunStopped: the process ended before it was done.
        """
        async with self._turn:
            return await asyncio.to_thread(self._work, job, args)

    def close(self) -> None:
        """End the process; safe to call twice."""
        if self._process is not None:
            self._process.terminate()
            self._process.join(2.0)
        self._forget()

    def _work(self, job: Callable[..., Any], args: tuple[Any, ...]) -> Any:
        if self._process is None or not self._process.is_alive():
            self._start()
        assert self._pipe is not None
        try:
            self._pipe.send((job, args))
            kind, told = self._pipe.recv()
        except (EOFError, OSError):
            self._forget()
            raise RunStopped(
                f"the process for {self._name} ended before it was done; ask again"
            ) from None
        if kind == "failed":
            raise BenchtoolError(told)
        return told

    def _start(self) -> None:
        spawn = get_context("spawn")
        self._pipe, theirs = spawn.Pipe()
        self._process = spawn.Process(
            target=work_through, args=(theirs,), name=f"benchtool {self._name}", daemon=True
        )
        self._process.start()
        theirs.close()

    def _forget(self) -> None:
        if self._pipe is not None:
            self._pipe.close()
        self._pipe = self._process = None


def work_through(pipe: Connection) -> None:
    """Do jobs that come through a pipe until it closes; the worker process runs this."""
    # Ctrl-C in the terminal ends the server, which ends this.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    while True:
        try:
            job, args = pipe.recv()
        except (EOFError, OSError):
            return
        try:
            pipe.send(("done", job(*args)))
        except BenchtoolError as error:
            pipe.send(("failed", str(error)))
        except Exception as error:  # noqa: BLE001 -- told to the page; the worker goes on
            traceback.print_exc(file=sys.stderr)
            pipe.send(("failed", fault_sentence(error)))
