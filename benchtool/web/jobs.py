"""Worker processes for computations, so that the server and STOP stay responsive.

`WorkerProcess` runs short calls sequentially; `Job` is a long computation with progress and
cancellation, which survives a page reload. Functions must be importable, arguments and results
picklable.
"""

from __future__ import annotations

import asyncio
import os
import shutil
import threading
import traceback
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import get_context
from multiprocessing.connection import Connection as Pipe
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from benchtool.core.errors import BenchtoolError, RunInterrupted
from benchtool.data.atomic import partial_folder
from benchtool.tasks import WorkerProcesses, exit_with_parent

if TYPE_CHECKING:
    from benchtool.web.drawing import Content

ReportProgress = Callable[[str, float], None]  # (stage, share from 0 to 1)
NICENESS = 5  # of a job, on POSIX systems; assumed
TERMINATION_TIMEOUT_S = 2.0  # a cancelled job still running after this is killed; assumed


def to_user_error(error: Exception) -> BenchtoolError:
    """Return the error to show; the traceback of an unexpected one is printed in the terminal."""
    if isinstance(error, BenchtoolError):
        return error
    traceback.print_exception(error)
    summary = " ".join(str(error).split())
    return BenchtoolError(
        f"internal error of benchtool, {type(error).__name__}: {summary}; please report it with "
        f"the traceback from the terminal of benchtool web"
    )


class WorkerProcess:
    """Process that runs short calls sequentially; started on the first call."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._pool: WorkerProcesses | None = None

    async def run(self, function: Callable[..., Any], *arguments: Any) -> Any:
        """Return the result of a function.

        Raises:
            BenchtoolError: raised by the function, or an unexpected error of it.
            RunInterrupted: the process ended unexpectedly.
        """
        pool = self._pool = self._pool or WorkerProcesses(1)
        try:
            return await asyncio.wrap_future(pool.submit(function, *arguments))
        except BrokenProcessPool:
            if self._pool is pool:
                self.close()
            raise RunInterrupted(
                f"the process for {self._name} ended unexpectedly; try again"
            ) from None
        except Exception as error:  # noqa: BLE001 -- the page shows every error
            raise to_user_error(error) from None

    def close(self) -> None:
        """End the process, even during a call; idempotent."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PageSection:
    """Section of the page, prepared by a worker process.

    Attributes:
        html: with escaped text.
        command: arguments of the equivalent `benchtool` command, or ().
    """

    title: str
    html: str
    simulated: bool = False
    command: tuple[str, ...] = ()

    @classmethod
    def draw(
        cls,
        title: str,
        blocks: Iterable[Content],
        *,
        simulated: bool = False,
        command: tuple[str, ...] = (),
    ) -> PageSection:
        """Return a section of report blocks; call only in worker processes."""
        from benchtool.web.drawing import blocks_html

        html = blocks_html(blocks)
        return cls(title=title, html=html, simulated=simulated, command=command)


@dataclass(frozen=True, slots=True, kw_only=True)
class JobState:
    """Job state.

    Attributes:
        stage: current or last stage.
        stages: all stages so far, in order.
        error: message of a failed job.
    """

    status: Literal["running", "done", "failed", "cancelled"] = "running"
    stage: str = "starting"
    share: float = 0.0
    stages: tuple[str, ...] = ()
    result: Any = None
    error: str = ""

    @property
    def running(self) -> bool:
        return self.status == "running"


class Job:
    """Computation of an output folder in a new process.

    Args:
        command: arguments of the equivalent `benchtool` command.
        function: called as function(report, out, command, *arguments) with a `ReportProgress`.
    """

    def __init__(
        self, out: Path, command: Sequence[str], function: Callable[..., Any], *arguments: Any
    ) -> None:
        self.out, self.command = out, tuple(command)
        spawn = get_context("spawn")
        pipe, child_pipe = spawn.Pipe()
        self.state = JobState()
        self._lock = threading.Lock()
        self._process = spawn.Process(
            target=_run_job,
            args=(child_pipe, function, (out, self.command, *arguments)),
            daemon=True,
            name=function.__name__,
        )
        self._process.start()
        child_pipe.close()
        self._reader = threading.Thread(target=self._read, args=(pipe,), daemon=True)
        self._reader.start()

    def cancel(self) -> None:
        """End the process if it is running and delete the partial folder."""
        if self._change(status="cancelled"):
            self._process.terminate()
            self._process.join(TERMINATION_TIMEOUT_S)
            if self._process.is_alive():
                self._process.kill()
        shutil.rmtree(partial_folder(self.out), ignore_errors=True)

    def wait(self, timeout_s: float | None = None) -> JobState:
        """Wait for the end or a timeout and return the state."""
        self._reader.join(timeout_s)
        return self.state

    def _read(self, pipe: Pipe) -> None:
        with pipe, suppress(EOFError, OSError):
            while True:
                changes = pipe.recv()
                stages, stage = self.state.stages, changes.get("stage")
                if stage is not None and stage not in stages[-1:]:
                    changes["stages"] = (*stages, stage)
                self._change(**changes)
        self._process.join()
        self._change(
            status="failed",
            error=f"the process ended unexpectedly (exit code {self._process.exitcode}), possibly "
            f"out of memory; reduce the size of the job or close other programs",
        )

    def _change(self, **changes: Any) -> bool:
        with self._lock:
            if not self.state.running:
                return False
            self.state = replace(self.state, **changes)
            return True


def _run_job(pipe: Pipe, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
    """Run a job's function in its process and send the changes of its state."""
    exit_with_parent(pipe)
    with suppress(AttributeError, OSError):
        os.nice(NICENESS)

    def report(stage: str, share: float) -> None:
        pipe.send({"stage": stage, "share": float(share)})

    try:
        outcome = {"status": "done", "share": 1.0, "result": function(report, *arguments)}
    except Exception as error:  # noqa: BLE001 -- the page shows every error
        outcome = {"status": "failed", "error": str(to_user_error(error))}
    with suppress(OSError):  # the server has ended
        pipe.send(outcome)
