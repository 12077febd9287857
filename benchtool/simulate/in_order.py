"""Run independent pieces of work on all cores and hand their results on in order."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from itertools import islice
from typing import TypeVar

T = TypeVar("T")


def results_in_order(tasks: Iterable[Callable[[], T]], threads: int | None = None) -> Iterator[T]:
    """Yield what each task returns, in the order of the tasks.

    Only one task more than there are threads is ever taken from `tasks` ahead of what was handed
    on, so that memory does not grow with their number. Compiled loops give the interpreter free
    while they run; threads are enough.

    Args:
        tasks: pieces of work that know nothing of each other.
        threads: how many at once; all cores when None.
    """
    workers = max(1, threads if threads is not None else (os.cpu_count() or 1))
    waiting = iter(tasks)
    pending: deque[Future[T]] = deque()
    pool = ThreadPoolExecutor(workers)
    try:
        while True:
            for task in islice(waiting, workers + 1 - len(pending)):
                pending.append(pool.submit(task))
            if not pending:
                return
            yield pending.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)
