"""Print what a task of 50 ms costs on a Dask cluster of two workers, beside a process pool of two.

Both sides take turns. The aims: at most 10 % over the pool, and 90 % of what two cores can do.
"""

from __future__ import annotations

import socket
import statistics
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

from distributed import Client

TASKS, ROUNDS = 200, 3


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
    try:
        with (
            ProcessPoolExecutor(2, get_context("spawn")) as pool,
            Client(where, timeout=30, set_as_default=False) as client,  # type: ignore[no-untyped-call]
        ):
            client.wait_for_workers(2)
            list(pool.map(task, range(8)))
            client.gather(client.map(task, range(1000, 1008), pure=False))
            ratios, idle_s = [], TASKS * 0.05 / 2
            for _ in range(ROUNDS):
                began = time.perf_counter()
                list(pool.map(task, range(TASKS)))
                pool_s = time.perf_counter() - began
                began = time.perf_counter()
                client.gather(client.map(task, range(TASKS), pure=False))
                dask_s = time.perf_counter() - began
                ratios.append(dask_s / pool_s)
                print(
                    f"{TASKS} tasks of 50 ms: pool {pool_s:.2f} s, Dask {dask_s:.2f} s, ratio "
                    f"{ratios[-1]:.3f}; two cores need {idle_s:.2f} s: pool {idle_s / pool_s:.0%}, "
                    f"Dask {idle_s / dask_s:.0%}"
                )
            print(f"median ratio {statistics.median(ratios):.3f} (aim 1.10)")
    finally:
        for process in processes:
            process.kill()
            process.wait()


if __name__ == "__main__":
    main()
