"""Campaigns: one simulation over a grid or a random design of numbers, results to disk."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from itertools import islice, product
from typing import Any, TypeVar

from benchtool.core.errors import InputError
from benchtool.simulate.design import Design

Row = Mapping[str, float | str]
Point = Mapping[str, float]
T = TypeVar("T")


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """One simulation at many points.

    Every point sees the same noise: seed k of one point is seed k of any other.

    Attributes:
        metadata: what was the same in all runs, for the table's file.
        setups: what is simulated, by the name of the gain set; each is run at every point.
        measures: what is measured, with its unit, by column; the main one first.
        probe: probe(setup, point, design) refuses a point that cannot be run.
        case: case(setup, controller, point) -> what is run there, under every seed.
        run: run(pairs of case and number of the seed, first seed, threads) -> the measures of
            each, in order.
    """

    title: str
    metadata: Mapping[str, str]
    setups: Mapping[str, Any]
    controllers: tuple[str, ...]
    measures: Mapping[str, str]
    probe: Callable[[Any, Point, Design], None]
    case: Callable[[Any, str, Point], Any]
    run: Callable[[Iterator[tuple[Any, int]], int, int | None], Iterator[Row]]

    def check(self, design: Design) -> None:
        """Refuse a design that cannot be run, before the first run."""
        for setup in self.setups.values():
            for point in design.probes():
                self.probe(setup, point, design)

    def rows(
        self, design: Design, threads: int | None = None, start: int = 0, stop: int | None = None
    ) -> Iterator[Row]:
        """Yield one row per gain set, controller, point and seed, in that order, as they come.

        A row has the point's numbers, `gains`, `controller`, `seed`, and the measures.

        Args:
            threads: how many runs at once; all cores when None.
        """
        labels: deque[Row] = deque()

        def cases() -> Iterator[tuple[Any, int]]:
            groups = product(self.setups.items(), self.controllers, design.points())
            for place, ((gains, setup), controller, point) in enumerate(groups):
                first = place * design.seeds
                numbers = range(max(start - first, 0), design.seeds)
                if stop is not None:
                    numbers = numbers[: max(stop - max(first, start), 0)]
                if not numbers:
                    continue
                case = self.case(setup, controller, point)
                for number in numbers:
                    seed = {"seed": float(design.seed + number)}
                    labels.append({**point, "gains": gains, "controller": controller, **seed})
                    yield case, number

        for measured in self.run(cases(), design.seed, threads):
            yield {**labels.popleft(), **measured}


def at_point(error: InputError, point: Point) -> InputError:
    """Return an error that says at which point of a design it came."""
    where = ", ".join(f"{name} = {value:g}" for name, value in point.items())
    return InputError(f"{error} (at {where})")


def results_in_order(tasks: Iterable[Callable[[], T]], threads: int | None = None) -> Iterator[T]:
    """Yield what each task returns, in the order of the tasks.

    Only one task more than there are threads is ever taken from `tasks` ahead of what was handed
    on, so that memory does not grow with their number. Compiled loops give the interpreter free
    while they run; threads are enough.

    Args:
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
