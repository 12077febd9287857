"""Work that takes processor time, in processes of its own: the page stays quick, Stop too.

Short calls run one after another in one process, which has its libraries loaded (`WorkerProcess`).
What takes minutes, reports progress and can be cancelled is a `Job`. It belongs to the server, not
to a browser: a page that is loaded again finds it. Work is a function at the top of a module; its
arguments and its result are pickled.
"""

from __future__ import annotations

import asyncio
import os
import shutil
import sys
import threading
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import get_context
from multiprocessing.connection import Connection as Pipe
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

from benchtool.core.errors import BenchtoolError, RunInterrupted
from benchtool.data.atomic import partial_folder
from benchtool.tasks import WorkerProcesses, exit_with_parent

T = TypeVar("T")

ReportProgress = Callable[[str, float], None]  # (what is being done, share from 0 to 1)
NICENESS = 5  # of a job, on POSIX systems; assumed
TERMINATION_TIMEOUT_S = 2.0  # How long a cancelled job may take to end before it is killed; a guess


class WorkerProcess:
    """Run short work, one call after another, in one process, started with the first of them."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._pool: WorkerProcesses | None = None

    async def run(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """Return what a function returns.

        Raises:
            BenchtoolError: what the function raised, with the same sentence.
            RunInterrupted: the process ended before it was done.
        """
        pool = self._pool = self._pool or WorkerProcesses(1)
        try:
            return await asyncio.wrap_future(pool.submit(work, *arguments))
        except BrokenProcessPool:
            if self._pool is pool:
                self.close()
            raise RunInterrupted(
                f"the process for {self._name} ended before it was done; try again"
            ) from None
        except BenchtoolError:
            raise
        except Exception as error:  # noqa: BLE001 -- whatever it is, the page must show it
            traceback.print_exception(error)
            raise BenchtoolError(format_fault(error)) from None

    def close(self) -> None:
        """End the process, whatever it does; safe to call twice."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PageSection:
    """Hold what a process has made ready for the page.

    Attributes:
        html: of its blocks, everything in it escaped.
        command: words behind `benchtool` that make the same; empty where there is none.
    """

    title: str
    html: str
    simulated: bool = False
    command: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class JobState(Generic[T]):
    """State how a job stands.

    Attributes:
        what: is being done, or was done last.
        stages: everything that was done so far, in order.
        error: one sentence, where it failed.
    """

    status: Literal["running", "done", "failed", "cancelled"] = "running"
    what: str = "starting"
    share: float = 0.0
    stages: tuple[str, ...] = ()
    result: T | None = None
    error: str = ""

    @property
    def running(self) -> bool:
        return self.status == "running"


class Job(Generic[T]):
    """Make a folder in a new process.

    Args:
        words: behind `benchtool` that do the same.
        work: called as work(report, out, words, *arguments); calls report(what, share) whenever it
            likes.
    """

    def __init__(
        self, out: Path, words: Sequence[str], work: Callable[..., T], *arguments: Any
    ) -> None:
        self.out, self.words = out, tuple(words)
        spawn = get_context("spawn")
        ours, theirs = spawn.Pipe()
        self._state: JobState[T] = JobState()
        self._changing = threading.Lock()
        self._process = spawn.Process(
            target=_run,
            args=(theirs, work, (out, self.words, *arguments)),
            daemon=True,
            name=work.__name__,
        )
        self._process.start()
        theirs.close()
        self._reader = threading.Thread(target=self._read, args=(ours,), daemon=True)
        self._reader.start()

    @property
    def state(self) -> JobState[T]:
        return self._state

    def cancel(self) -> None:
        """End the process where it still runs, and delete what stands under the hidden name."""
        if self._change(status="cancelled"):
            self._process.terminate()
            self._process.join(TERMINATION_TIMEOUT_S)
            if self._process.is_alive():
                self._process.kill()
        shutil.rmtree(partial_folder(self.out), ignore_errors=True)

    def wait(self, timeout_s: float | None = None) -> JobState[T]:
        """Return how it stands once it has ended, or after so long."""
        self._reader.join(timeout_s)
        return self._state

    def _read(self, pipe: Pipe) -> None:
        with pipe, suppress(EOFError, OSError):
            while True:
                status, *content = pipe.recv()
                if status == "running":
                    what, share = content
                    stages = self._state.stages
                    if stages[-1:] != (what,):
                        stages = (*stages, what)
                    self._change(what=what, share=share, stages=stages)
                elif status == "done":
                    self._change(status="done", share=1.0, result=content[0])
                else:
                    self._change(status="failed", error=content[0])
        self._process.join()
        self._change(
            status="failed",
            error=f"the work ended without an answer (exit code {self._process.exitcode}), as "
            f"when memory runs out; request less, or close other programs",
        )

    def _change(self, **changes: Any) -> bool:
        with self._changing:
            if not self._state.running:
                return False
            self._state = replace(self._state, **changes)
            return True


def format_fault(error: Exception) -> str:
    """Return that a fault is benchtool's own; its traceback stands where the server was started."""
    summary = " ".join(str(error).split())
    return (
        f"a fault in benchtool itself, {type(error).__name__}: {summary}; please report it with "
        f"what was printed where benchtool web runs"
    )


def _outcome(work: Callable[..., Any], arguments: tuple[Any, ...]) -> tuple[str, Any]:
    """Return the status and the result of some work, or its error in one sentence."""
    try:
        return "done", work(*arguments)
    except BenchtoolError as error:
        return "failed", str(error)
    except Exception as error:  # noqa: BLE001 -- whatever it is, the page must show it
        traceback.print_exc(file=sys.stderr)
        return "failed", format_fault(error)


def _run(pipe: Pipe, work: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    """Do a job's work in its process and send what comes of it."""
    exit_with_parent(pipe)
    with suppress(AttributeError, OSError):
        os.nice(NICENESS)

    def report(what: str, share: float) -> None:
        pipe.send(("running", what, float(share)))

    outcome = _outcome(work, (report, *arguments))
    with suppress(OSError):  # the server has gone
        pipe.send(outcome)
