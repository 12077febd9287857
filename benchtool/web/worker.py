"""Work that takes processor time, in a process of its own: the page stays quick, Stop too.

A job is a function at the top of a module. One that yields tells what it yields while it works;
what it returns is the result.
"""

from __future__ import annotations

import asyncio
import signal
from collections.abc import Callable
from multiprocessing import get_context
from multiprocessing.connection import Connection
from types import GeneratorType
from typing import Any

from benchtool.errors import BenchtoolError, RunStopped

Heard = Callable[[Any], None]


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

    async def run(self, job: Callable[..., Any], *args: Any, heard: Heard | None = None) -> Any:
        """Return what a job returns; `heard` is called in the page's loop with what it yields.

        Raises:
            BenchtoolError: what the job raised, with the same sentence.
            RunStopped: it was cancelled.
        """
        loop = asyncio.get_running_loop()

        def tell(news: Any) -> None:
            if heard is not None:
                loop.call_soon_threadsafe(heard, news)

        async with self._turn:
            return await asyncio.to_thread(self._work, job, args, tell)

    def cancel(self) -> None:
        """End the job that runs, and the process with it; the next job gets a new one."""
        if self._process is not None:
            self._process.terminate()

    def close(self) -> None:
        """End the process; safe to call twice."""
        self.cancel()
        if self._process is not None:
            self._process.join(2.0)
        self._forget()

    def _work(self, job: Callable[..., Any], args: tuple[Any, ...], tell: Heard) -> Any:
        if self._process is None or not self._process.is_alive():
            self._start()
        assert self._pipe is not None
        try:
            self._pipe.send((job, args))
            while True:
                kind, told = self._pipe.recv()
                if kind == "news":
                    tell(told)
                elif kind == "done":
                    return told
                else:
                    raise BenchtoolError(told)
        except (EOFError, OSError):
            self._forget()
            raise RunStopped(f"{self._name} was cancelled; nothing was kept of it") from None

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
            pipe.send(("done", _result(job(*args), pipe)))
        except BenchtoolError as error:
            pipe.send(("failed", str(error)))
        except Exception as error:  # noqa: BLE001 -- told to the page; the worker goes on
            said = " ".join(str(error).split())
            told = f"a fault in benchtool itself, {type(error).__name__}: {said}; please report it"
            pipe.send(("failed", told))


def _result(returned: Any, pipe: Connection) -> Any:
    if not isinstance(returned, GeneratorType):
        return returned
    while True:
        try:
            pipe.send(("news", next(returned)))
        except StopIteration as end:
            return end.value
