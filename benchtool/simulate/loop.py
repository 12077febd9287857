"""Compiled loop with its arrays, common to hinged and free bodies, and runs in threads."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from itertools import islice
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from benchtool.core.units import Array
from benchtool.simulate.layout import Layout, lend_rows
from benchtool.simulate.user_controller import controller_error, invalid_command_error

T = TypeVar("T")


def command_ring(layout: Layout, w: Array, substeps: int) -> tuple[int, bool]:
    """Return the length of the ring buffer of commands for records (n_rows, n_lanes), and True if
    commands act late.
    """
    steps = w[layout.rows("motion.delay_steps")]
    late = [w[layout.rows(f"motion.{half}.old")].any() for half in ("first", "second")]
    return int(steps.max()) // substeps + 3, bool(steps.any() or any(late))


class Loop(ABC):
    """Compiled loop of a body with its arrays.

    Attributes:
        loops: named tuple of compiled functions; `run(arrays, plan, first, last)` runs control
            ticks and returns the tick at which the run ended.
        arrays: named tuple of arrays; change them in place, or replace them by `use`.
        plan: a `LoopPlan` (n_settings,).
        rate_Hz: control rate.
    """

    loops: Any
    layout: Layout
    arrays: Any
    lanes: int = 1
    plan: NDArray[np.int64]
    rate_Hz: float
    advance: Callable[[int, int], int]

    def use(self, arrays: Any, plan: Sequence[int] | None = None) -> None:
        """Use these arrays from now on."""
        self.arrays = arrays
        if plan is not None:
            self.plan = np.array(plan, np.int64)
        self.advance = partial(self.loops.run, lend_rows(self.loops.run, arrays), self.plan)

    def view(self, field: str) -> Array:
        """Return a view of a record or field, for example "hinge.theta_rad" (n, n_lanes)."""
        view: Array = self.arrays.w.reshape(-1, self.lanes)[self.layout.rows(field)]
        return view

    @abstractmethod
    def measure(self, time_s: float) -> Any:
        """Return the readings for a user-defined controller."""

    @abstractmethod
    def references(self, first: int, last: int) -> list[Any]:
        """Return the references of control ticks."""

    @abstractmethod
    def write_command(self, command: Any) -> None:
        """Write the command of a user-defined controller; TypeError or ValueError if invalid."""

    @abstractmethod
    def invalid_field(self, command: Any) -> tuple[str, Any, str]:
        """Return name and value of the first invalid field of a command, and the remedy."""

    def run_controller(self, controller: Any, first: int, last: int, ticks_before: int = 0) -> int:
        """Run control ticks with a user-defined controller; return the tick of the end.

        The driver of the loop must be `CALLER`.

        Args:
            ticks_before: number of ticks of the controller's run before `first`.

        Raises:
            InputError: the controller raised, or returned an invalid command.
        """
        step, advance = controller.step, self.advance
        measure, write = self.measure, self.write_command
        rate_Hz, dt_s = self.rate_Hz, 1.0 / self.rate_Hz
        for number, reference in enumerate(self.references(first, last)):
            time_s = (ticks_before + number) / rate_Hz
            try:
                command = step(measure(time_s), reference, dt_s)
            except (Exception, SystemExit) as error:
                raise controller_error(controller, error, time_s) from error
            try:
                write(command)
            except (TypeError, ValueError):
                field, value, remedy = self.invalid_field(command)
                raise invalid_command_error(controller, field, value, time_s, remedy) from None
            tick = first + number
            if advance(tick, tick + 1) == tick:
                return tick
        return last


def results_in_order(tasks: Iterable[Callable[[], T]], threads: int | None = None) -> Iterator[T]:
    """Yield the result of each task, in the order of the tasks.

    At most one task more than the number of threads is taken from `tasks` ahead of the yielded
    results, which bounds the memory. Compiled loops release the interpreter lock: threads suffice.

    Args:
        threads: number of parallel tasks; None means all cores.
    """
    workers = max(1, threads if threads is not None else (os.cpu_count() or 1))
    remaining = iter(tasks)
    pending: deque[Future[T]] = deque()
    pool = ThreadPoolExecutor(workers)
    try:
        while True:
            for task in islice(remaining, workers + 1 - len(pending)):
                pending.append(pool.submit(task))
            if not pending:
                return
            yield pending.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)
