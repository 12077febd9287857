"""Print what tasks of 50 ms cost by `run_tasks`: on a Dask cluster, in processes, without either.

Two workers, two processes, and a bare pool of two processes take turns; every result is stored,
but for those of the bare pool. The least of all rounds counts: other programs only add. The aims:
at most 10 % over the pool, and 90 % of what two cores can do.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from benchtool.tasks import TaskStore, run_tasks

TASKS, ROUNDS = 200, 6


def task(_: int) -> float:
    """Take 50 ms of a core."""
    began = time.process_time()
    x = 0.0
    while time.process_time() - began < 0.05:
        x += 1.0
    return x


def address() -> str:
    """Return where a scheduler can listen."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"tcp://127.0.0.1:{free.getsockname()[1]}"


def timed(run: Callable[[], object]) -> float:
    """Return how long something takes: s."""
    began = time.perf_counter()
    run()
    return time.perf_counter() - began


def stored(folder: Path, cluster: str | None) -> float:
    """Return how long the tasks take by the seam, without its start: s."""
    items = {str(k): k for k in range(TASKS + 2)}
    with TaskStore(folder / f"{time.time_ns()}.jsonl", {}) as store:
        running = run_tasks(task, items, store=store, cluster=cluster, processes=2)
        next(running)  # client or processes have started
        next(running)
        return timed(lambda: list(running))


def main() -> None:
    where = address()
    start = [sys.executable, "-m"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    processes = [
        subprocess.Popen([*start, "distributed.cli.dask_scheduler", "--host", where,
                          "--no-dashboard"], **quiet)
    ]  # fmt: skip
    worker = [*start, "distributed.cli.dask_worker", where, "--nthreads", "1", "--no-nanny",
              "--no-dashboard"]  # fmt: skip
    processes += [subprocess.Popen(worker, **quiet) for _ in range(2)]
    time.sleep(10.0)  # until workers have found the scheduler
    try:
        with (
            ProcessPoolExecutor(2, get_context("spawn")) as pool,
            tempfile.TemporaryDirectory() as name,
        ):
            list(pool.map(task, range(8)))
            stored(Path(name), where)
            found: dict[str, list[float]] = {"bare pool": [], "processes": [], "Dask": []}
            for _ in range(ROUNDS):
                found["bare pool"].append(timed(lambda: list(pool.map(task, range(TASKS)))))
                found["processes"].append(stored(Path(name), None))
                found["Dask"].append(stored(Path(name), where))
                print(", ".join(f"{kind} {one[-1]:.2f} s" for kind, one in found.items()))
            for kind, one in found.items():
                print(
                    f"{kind}: {min(one) / min(found['bare pool']):.3f} of the bare pool's time, "
                    f"{TASKS * 0.05 / 2 / min(one):.0%} of what two cores can do",
                    flush=True,
                )
    finally:
        for process in processes:
            process.kill()
            process.wait()


if __name__ == "__main__":
    main()
