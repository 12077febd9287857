"""Work in other processes: independent tasks on this machine or a Dask cluster, and single jobs.

A task is a module-level function and one item that contains all random seeds, so a task can be
repeated on another worker with the same result. Results are JSON data. With a store, each result
is written when it arrives, and the same call later runs the missing tasks only.

A job is one long function with progress and cancellation. Functions must be importable, arguments
and results picklable.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import signal
import socket
import sys
import threading
import traceback
import warnings
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import (
    CancelledError,
    Future,
    InvalidStateError,
    ProcessPoolExecutor,
    as_completed,
)
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection as Pipe
from operator import methodcaller
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self, TypeVar
from urllib.parse import urlsplit

from benchtool.core.errors import (
    BenchtoolError,
    FileFormatError,
    InputError,
    LinkLost,
    MissingLibrary,
    ResourceExhausted,
    RunInterrupted,
    show_warning,
)
from benchtool.core.inputs import Input

if TYPE_CHECKING:
    from distributed import Client

T = TypeVar("T")
Work = Callable[[T], Any]  # returns JSON data: numbers, text, lists and dictionaries
ReportProgress = Callable[[str, float], None]  # (stage, share from 0 to 1)

Cluster = Annotated[  # option of all commands with many tasks
    str | None, Input("Dask scheduler: tcp://HOST:8786.", default_text="this machine")
]

CONNECT_TIMEOUT_S = 10.0  # of the scheduler; assumed
MAX_ROUNDS = 3  # successive crashes of the worker processes without any result; assumed
TERMINATION_TIMEOUT_S = 2.0  # a cancelled job still running after this is killed; assumed


class TaskStore:
    """Results of tasks in a file, one JSON line each; `about` identifies the work.

    Raises:
        InputError: the file contains results of other work, or another process writes it.
    """

    def __init__(self, path: Path, about: Mapping[str, str]) -> None:
        self.path = path
        self._made_folder = not path.parent.exists()
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("a+b")
        self._offsets: dict[str, int] = {}
        try:
            self._claim(dict(about))
        except BaseException:
            self._file.close()
            raise
        self.key = hashlib.sha256(f"{path.resolve()} {about}".encode()).hexdigest()[:16]

    def _claim(self, about: dict[str, str]) -> None:
        """Lock the file, index its results without an incomplete last line, and check `about`."""
        if sys.platform != "win32":
            import fcntl

            try:
                fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise InputError(
                    f"another process is writing {self.path}; wait until it has finished"
                ) from None
        self._file.seek(0)
        end, stored = 0, None
        for line in self._file:
            if not line.endswith(b"\n"):
                break
            try:
                row = json.loads(line)
                if stored is None:
                    stored = row["about"]
                else:
                    self._offsets[row["task"]] = end
            except (ValueError, KeyError, TypeError) as error:
                raise FileFormatError(
                    str(self.path), f"not a file of task results ({error}); use another folder"
                ) from error
            end += len(line)
        self._file.truncate(end)
        if stored is None:
            self._append({"about": about})
        elif stored != about:
            changed = sorted(key for key in {*stored, *about} if stored.get(key) != about.get(key))
            raise InputError(
                f"{self.path} contains results of other work ({', '.join(changed)} differ); use "
                f"another folder with --out, or repeat the original command"
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
        if not len(self):  # remove an empty store
            self.path.unlink(missing_ok=True)
            if self._made_folder:
                with suppress(OSError):
                    self.path.parent.rmdir()

    def __len__(self) -> int:
        return len(self._offsets)

    def __contains__(self, task: str) -> bool:
        return task in self._offsets

    def __getitem__(self, task: str) -> Any:
        self._file.seek(self._offsets[task])
        return json.loads(self._file.readline())["result"]

    def __setitem__(self, task: str, result: Any) -> None:
        self._offsets[task] = self._append({"task": task, "result": result})

    def _append(self, row: Mapping[str, Any]) -> int:
        position = self._file.seek(0, os.SEEK_END)
        # NumPy scalars become Python numbers.
        self._file.write(json.dumps(row, default=methodcaller("item")).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())
        return position


def run_tasks(
    work: Work[T],
    tasks: Mapping[str, T],
    *,
    store: TaskStore | None = None,
    cluster: str | None = None,
    processes: int | None = None,
) -> Iterator[tuple[str, Any]]:
    """Yield name and result of each task: stored ones first, then others on completion.

    Args:
        work: module-level function or a `partial` of one; pickled like the items.
        cluster: address of a Dask scheduler; its workers need access to the files of the items.
        processes: on this machine; None means one per core, 0 means this process only.

    Raises:
        InputError: Dask is missing, or the scheduler does not respond.
        LinkLost: connection to the scheduler lost, or its workers crash repeatedly.
        ResourceExhausted: worker processes of this machine crash repeatedly.
        BenchtoolError: raised by a task.
    """
    client = None if cluster is None else _client(cluster)
    remaining = {name: item for name, item in tasks.items() if store is None or name not in store}
    if store is not None:
        yield from ((name, store[name]) for name in tasks if name not in remaining)
    if client is not None:
        results = _on_cluster(client, str(cluster), work, remaining, store)
    elif processes == 0 or len(remaining) < 2:
        results = ((name, work(item)) for name, item in remaining.items())
    else:
        n_processes = min(processes or os.cpu_count() or 1, len(remaining))
        results = _in_processes(work, remaining, n_processes)
    for name, result in results:
        if store is not None:
            store[name] = result
        yield name, result


def _in_processes(
    work: Work[T], remaining: dict[str, T], processes: int
) -> Iterator[tuple[str, Any]]:
    rounds_without_result = 0
    while remaining and rounds_without_result < MAX_ROUNDS:
        n_before = len(remaining)
        # May be raised by submit, and once per lost task.
        with WorkerProcesses(processes) as pool, suppress(BrokenProcessPool):
            futures = {pool.submit(work, item): name for name, item in remaining.items()}
            for future in as_completed(futures):
                with suppress(BrokenProcessPool):
                    result = future.result()
                    name = futures.pop(future)
                    del remaining[name]
                    yield name, result
        rounds_without_result = 0 if len(remaining) < n_before else rounds_without_result + 1
    if remaining:
        raise ResourceExhausted(
            f"worker processes ended {MAX_ROUNDS} times before any of {len(remaining)} tasks "
            f"was done, possibly out of memory; close other programs and repeat the command"
        )


class WorkerProcesses(ProcessPoolExecutor):
    """Executor whose processes end with its shutdown or with this process."""

    def __init__(self, count: int) -> None:
        spawn = get_context("spawn")
        self._child_end, self._parent_end = spawn.Pipe(duplex=False)
        super().__init__(count, spawn, _set_up_process, (self._child_end,))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        self._parent_end.close()
        super().shutdown(wait, cancel_futures=cancel_futures)
        self._child_end.close()


def _set_up_process(parent: Pipe | None) -> None:
    """Set one-line warnings, ignore Ctrl-C, and exit when the parent closes the pipe, if any."""
    warnings.showwarning = show_warning
    # Ctrl-C ends the parent, which ends this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if parent is None:
        return

    def end() -> None:
        with suppress(EOFError, OSError):
            parent.recv()
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


class Job(Future[Any]):
    """Future of a function in a new process, with the stages of its progress.

    The error of a job is a BenchtoolError; RunInterrupted if the process ended unexpectedly.

    Args:
        function: called as function(report, *arguments) with a `ReportProgress`.
        niceness: of the process, on POSIX systems.
        daemon: end the process with this one; False for work that must be completed.
    """

    def __init__(
        self,
        function: Callable[..., Any],
        *arguments: Any,
        niceness: int = 0,
        daemon: bool = True,
    ) -> None:
        super().__init__()
        self.stages: tuple[str, ...] = ()  # all so far, in order
        self.share = 0.0
        spawn = get_context("spawn")
        pipe, child_pipe = spawn.Pipe()
        self._process = spawn.Process(
            target=_run_job, args=(child_pipe, function, arguments, niceness, daemon), daemon=daemon
        )
        self._process.start()
        child_pipe.close()
        threading.Thread(target=self._receive, args=(pipe,), daemon=True).start()

    @property
    def succeeded(self) -> bool:
        return self.done() and not self.cancelled() and self.exception() is None

    @property
    def stage(self) -> str:
        return self.stages[-1] if self.stages else "starting"

    def report(self, stage: str, share: float) -> None:
        """Set stage and share; called by the function in its process."""
        self.share = share
        if stage not in self.stages[-1:]:
            self.stages = (*self.stages, stage)

    def cancel(self) -> bool:
        """End the process if it is running; return whether the job is cancelled."""
        is_cancelled = super().cancel()
        if is_cancelled:
            self._process.terminate()
            self._process.join(TERMINATION_TIMEOUT_S)
            if self._process.is_alive():
                self._process.kill()
        return is_cancelled

    def _receive(self, pipe: Pipe) -> None:
        """Receive calls of this object's methods until the process ends."""
        with suppress(InvalidStateError):  # cancelled
            with pipe, suppress(EOFError, OSError):
                while True:
                    method, arguments = pipe.recv()
                    getattr(self, method)(*arguments)
            self._process.join()
            if not self.done():
                error = RunInterrupted(
                    f"the process ended unexpectedly (exit code {self._process.exitcode}), "
                    f"possibly out of memory; reduce the size of the job or close other programs"
                )
                self.set_exception(error)


def _run_job(
    pipe: Pipe, function: Callable[..., Any], arguments: Any, niceness: int, daemon: bool
) -> None:
    """Run a job's function in its process and send calls of the job's methods."""
    _set_up_process(pipe if daemon else None)
    with suppress(AttributeError, OSError):
        os.nice(niceness)

    def report(stage: str, share: float) -> None:
        pipe.send(("report", (stage, float(share))))

    method, outcome = "set_result", None
    try:
        outcome = function(report, *arguments)
    except Exception as error:  # noqa: BLE001 -- the job shows every error
        method, outcome = "set_exception", to_user_error(error)
    with suppress(OSError):  # the parent has ended
        pipe.send((method, (outcome,)))


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


def _client(address: str) -> Client:
    try:
        from distributed import Client
    except ImportError:
        raise MissingLibrary("Dask", "--cluster", "cluster") from None
    # Errors are reported by the exceptions below.
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    url = urlsplit(address)
    try:
        # A failed Client leaves threads that log errors at exit.
        with socket.create_connection((url.hostname or "", url.port or 0), CONNECT_TIMEOUT_S):
            pass
        return Client(address, timeout=CONNECT_TIMEOUT_S, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise InputError(
            f"no Dask scheduler at {address} ({error}); start one with: dask scheduler, workers "
            f"with: dask worker tcp://HOST:8786, and use --cluster tcp://HOST:8786"
        ) from error


def _on_cluster(
    client: Client, address: str, work: Work[T], remaining: Mapping[str, T], store: TaskStore | None
) -> Iterator[tuple[str, Any]]:
    from distributed.scheduler import KilledWorker

    location = "" if store is None else f"; results are in {store.path}"
    # Unique per work: the scheduler returns one result per key.
    key = client.id if store is None else store.key
    with client:
        pool = client.get_executor()  # type: ignore[no-untyped-call]
        futures = {
            pool.submit(work, item, key=f"benchtool-{key}-{name}"): name
            for name, item in remaining.items()
        }
        try:
            for future in as_completed(futures):
                yield futures.pop(future), future.result()
        except KilledWorker as error:
            raise LinkLost(
                f"workers of {address} crashed repeatedly at one task ({error}){location}; check "
                f"the workers, and repeat the command"
            ) from error
        except CancelledError as error:
            raise LinkLost(
                f"connection to the scheduler at {address} lost{location}; restart scheduler and "
                f"workers, and repeat the command"
            ) from error
