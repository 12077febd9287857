"""Many tasks that know nothing of each other: in processes of this machine, or on a Dask cluster.

A task is a function at the top of a module and one item, which holds every seed that it needs: the
same item gives the same result wherever it runs, so that a task whose worker died is run again.
A result is plain JSON data. With a store each is on the disk as it comes; the same call then runs
what is missing, whoever ended: worker, scheduler or client.
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
import warnings
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection as Pipe
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self, TypeVar
from urllib.parse import urlsplit

from benchtool.core.errors import (
    FileFormatError,
    InputError,
    LinkLost,
    MissingLibrary,
    ResourceExhausted,
    show_warning,
)
from benchtool.core.inputs import Input

if TYPE_CHECKING:
    from distributed import Client

T = TypeVar("T")
Result = Any  # what JSON holds: numbers, text, lists and dictionaries of them

Work = Callable[[T], Result]

Cluster = Annotated[  # input of every command that has many tasks
    str | None,
    Input("Dask scheduler, as tcp://HOST:8786, whose workers do it.", default_text="this machine"),
]

CONNECT_TIMEOUT_S = 10.0  # time in which a scheduler must answer
MAX_ROUNDS = 3  # so often processes may die one after the other without a single result


class TaskStore:
    """Results of tasks in a file, a line each as they come.

    Args:
        path: of the file; made where there is none.
        about: of which work these are results, in words that another work has not.

    Raises:
        InputError: the file holds results of other work, or another process writes it.
    """

    def __init__(self, path: Path, about: Mapping[str, str]) -> None:
        self.path = path
        self._made_folder = not path.parent.exists()
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = path.open("a+b")
        self._places: dict[str, int] = {}
        try:
            self._lock()
            self._claim(dict(about))
        except BaseException:
            self._file.close()
            raise
        self.key = hashlib.sha256(f"{path.resolve()} {about}".encode()).hexdigest()[:16]

    def _lock(self) -> None:
        if sys.platform == "win32":
            return
        import fcntl

        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"another process writes {self.path} now; wait until it has ended"
            ) from None

    def _claim(self, about: dict[str, str]) -> None:
        """Find what is stored, drop the line that a kill has torn, and see that it is ours."""
        self._file.seek(0)
        end, found = 0, None
        for line in self._file:
            if not line.endswith(b"\n"):
                break
            try:
                row = json.loads(line)
                if found is None:
                    found = row["about"]
                else:
                    self._places[row["task"]] = end
            except (ValueError, KeyError, TypeError) as error:
                raise FileFormatError(
                    str(self.path), f"no store of finished tasks ({error}); name another folder"
                ) from error
            end += len(line)
        self._file.truncate(end)
        if found is None:
            self._append({"about": about})
        elif found != about:
            changed = sorted(key for key in {*found, *about} if found.get(key) != about.get(key))
            raise InputError(
                f"{self.path} holds results of other work ({', '.join(changed)} differ); name "
                f"another folder with --out, or repeat the command that began it"
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()
        if not len(self):  # nothing was done: nothing is left behind
            self.path.unlink(missing_ok=True)
            if self._made_folder:
                with suppress(OSError):
                    self.path.parent.rmdir()

    def __len__(self) -> int:
        return len(self._places)

    def __contains__(self, task: str) -> bool:
        return task in self._places

    def __getitem__(self, task: str) -> Result:
        self._file.seek(self._places[task])
        return json.loads(self._file.readline())["result"]

    def __setitem__(self, task: str, result: Result) -> None:
        self._places[task] = self._append({"task": task, "result": result})

    def _append(self, row: Mapping[str, Any]) -> int:
        place = self._file.seek(0, os.SEEK_END)
        self._file.write(json.dumps(row, default=_plain).encode() + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())
        return place


def _plain(value: Any) -> Any:
    """Return a number of NumPy's as one of Python's."""
    if hasattr(value, "item"):
        return value.item()
    raise TypeError(f"{value!r} is no JSON data")


def run_tasks(
    work: Work[T],
    tasks: Mapping[str, T],
    *,
    store: TaskStore | None = None,
    cluster: str | None = None,
    processes: int | None = None,
) -> Iterator[tuple[str, Result]]:
    """Yield name and result of each task: first those that are stored, then others as they end.

    Args:
        work: at the top of a module, or a `partial` of such a function; pickled, as items are.
        tasks: item by name.
        store: of results.
        cluster: address of a Dask scheduler; files that items name must be where its workers are.
        processes: on this machine; one for each core when None, this process alone when 0.

    Raises:
        InputError: Dask is missing, or no scheduler answers.
        LinkLost: the scheduler was lost, or its workers died again and again.
        ResourceExhausted: processes here did.
        BenchtoolError: of a task, with its class and its sentence.
    """
    client = None if cluster is None else _client(cluster)
    left = {name: item for name, item in tasks.items() if store is None or name not in store}
    if store is not None:
        yield from ((name, store[name]) for name in tasks if name not in left)
    if client is not None:
        found = _on_cluster(client, str(cluster), work, left, store)
    elif processes == 0 or len(left) < 2:
        found = ((name, work(item)) for name, item in left.items())
    else:
        found = _in_processes(work, left, min(processes or os.cpu_count() or 1, len(left)))
    for name, result in found:
        if store is not None:
            store[name] = result
        yield name, result


def _in_processes(
    work: Work[T], left: dict[str, T], processes: int
) -> Iterator[tuple[str, Result]]:
    fruitless = 0
    while left:
        done = len(left)
        # Suppressed: it may come while tasks are submitted, and once for each task that is lost.
        with WorkerProcesses(processes) as pool, suppress(BrokenProcessPool):
            futures = {pool.submit(work, item): name for name, item in left.items()}
            for future in as_completed(futures):
                with suppress(BrokenProcessPool):
                    result = future.result()
                    name = futures.pop(future)
                    del left[name]
                    yield name, result
        fruitless = fruitless + 1 if len(left) == done else 0
        if fruitless == MAX_ROUNDS:
            raise ResourceExhausted(
                f"processes ended {MAX_ROUNDS} times before any of {len(left)} tasks was done, as "
                f"when memory runs out; close other programs and repeat the command"
            )


class WorkerProcesses(ProcessPoolExecutor):
    """Executor whose processes end at once when it is shut down, or when this process is gone."""

    def __init__(self, count: int) -> None:
        spawn = get_context("spawn")
        self._theirs, self._lifeline = spawn.Pipe(duplex=False)
        super().__init__(count, spawn, exit_with_parent, (self._theirs,))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        self._lifeline.close()
        super().shutdown(wait, cancel_futures=cancel_futures)
        self._theirs.close()


def exit_with_parent(lifeline: Pipe) -> None:
    """Print warnings as lines, and end this process when its parent closes a pipe or is gone."""
    warnings.showwarning = show_warning
    # Ctrl-C in the terminal ends the parent, which ends this.
    signal.signal(signal.SIGINT, signal.SIG_IGN)

    def end() -> None:
        with suppress(EOFError, OSError):
            lifeline.recv()
        os._exit(1)

    threading.Thread(target=end, daemon=True).start()


def _client(address: str) -> Client:
    try:
        from distributed import Client
    except ImportError:
        raise MissingLibrary("Dask", "--cluster", "cluster") from None
    # What goes wrong is said in a sentence of our own.
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    place = urlsplit(address)
    try:
        # Dask's own attempt leaves threads behind that complain at the end.
        with socket.create_connection((place.hostname or "", place.port or 0), CONNECT_TIMEOUT_S):
            pass
        return Client(address, timeout=CONNECT_TIMEOUT_S, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise InputError(
            f"no Dask scheduler answers at {address} ({error}); start one with: dask scheduler, "
            f"workers with: dask worker tcp://HOST:8786, and name it as --cluster tcp://HOST:8786"
        ) from error


def _on_cluster(
    client: Client, address: str, work: Work[T], left: Mapping[str, T], store: TaskStore | None
) -> Iterator[tuple[str, Result]]:
    from distributed.scheduler import KilledWorker

    finished = "" if store is None else f"; what is finished is in {store.path}"
    # A name that other work has not: the scheduler gives one result for one name.
    key = client.id if store is None else store.key
    with client:
        pool = client.get_executor()  # type: ignore[no-untyped-call]
        futures = {
            pool.submit(work, item, key=f"benchtool-{key}-{name}"): name
            for name, item in left.items()
        }
        try:
            for future in as_completed(futures):
                yield futures.pop(future), future.result()
        except KilledWorker as error:
            raise LinkLost(
                f"workers of {address} died several times at one task ({error}){finished}; look "
                f"at the workers, and repeat the command"
            ) from error
        except CancelledError as error:
            raise LinkLost(
                f"the scheduler at {address} was lost{finished}; start a scheduler and workers "
                f"again, and repeat the command"
            ) from error
