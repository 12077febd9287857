"""Closed loop of a hinged or free vehicle: control ticks that consist of plant steps.

The same source runs a single run, a batch (lanes that the compiler vectorises), a controller in
Python (one tick per call), a filter along a log, and plain NumPy without numba. A phase is a part
of a tick, phase(arrays, now): it reads and writes records of every lane.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections import deque, namedtuple
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from itertools import islice
from typing import Any, TypeVar

import numpy as np

from benchtool.core.units import Array
from benchtool.physics.expression import (
    Slot,
    compiled_closure,
    inlined_expression,
    read_record,
    shared_view,
)
from benchtool.simulate.controllers.controller import controller_error, invalid_command_error
from benchtool.simulate.hooks import apply_delayed_commands
from benchtool.simulate.layout import Layout, lend_rows

T = TypeVar("T")

BUILT_IN, CALLER, PULSES = range(3)  # source of commands: law, caller, or scheduled pulse widths

LoopPlan = namedtuple(
    "LoopPlan",
    "substeps driver delayed log_every ticks_before is_at_rest theta_delay rate_delay plate_delay",
    defaults=(1, 0, 0, 1, 0, 0, 0, 0, 0),
)
"""Integer settings of a run.

Attributes:
    substeps: plant steps per tick.
    ticks_before: number of earlier ticks, for the time of the first one.
    is_at_rest: 1 for a plant at rest: commands are stored for the delay, and nothing moves.
    theta_delay, rate_delay, plate_delay: delays of the sensors of a bench in ticks.
"""

PLAN = Slot(0, LoopPlan())


# Compile-time settings: lanes; slots of records, of the geometry and of one column of a schedule.
Build = namedtuple("Build", "lanes slots geometry scheduled")

# State of the loop: tick, its start time, plant step within it, plan; the geometry with the length
# of a plant step `dt_s`, common to all lanes, and the schedule entry of the tick.
Instant = namedtuple("Instant", "tick time_s part plan geometry scheduled")

Phases = namedtuple("Phases", "law mix move sense is_running")
"""Phases of a tick.

Attributes:
    mix: from commands to target speeds of the motors.
    move: a plant step: heights and coverages, forces and torques, motion.
    is_running: is_running(arrays) -> false at the end of the run.
"""


@inlined_expression
def no_phase(arrays: Any, now: Any) -> None:
    """Empty phase (no-op)."""


@inlined_expression
def always_true(arrays: Any) -> bool:
    """Return True: the run has no other end than its last tick."""
    return True


@inlined_expression
def run_ticks(arrays: Any, first: Any, last: Any, build: Any, phases: Any) -> Any:
    """Run control ticks of all lanes, and return the tick at which the run ended.

    Args:
        arrays: `w`, the records of all lanes, flat, row times lanes plus lane; `sent`, ring buffer
            of commanded speeds (n_rotors, n_ring, n_lanes); `log` (n_rows, n_logged, n_lanes) of
            the rows `logged` of `w`; `plan`; and further arrays for the phases.
        first: first control tick; -1 only reads the sensors.
        last: end of the control ticks (exclusive).
        build: the number of lanes is known at compile time, and the loops over lanes contain no
            other loop.
    """
    w, slots, n_lanes, schedule = arrays.w, build.slots, len(build.lanes), arrays.schedule
    settings = read_record(arrays.plan, PLAN, 0, 1)
    geometry, ring = read_record(arrays.geometry, build.geometry, 0, 1), arrays.sent.shape[1]
    substeps, log_every = settings.substeps, settings.log_every
    steps = substeps * (1 - settings.is_at_rest)
    position, row = max(first, 0) % ring, (max(first, 0) + log_every - 1) // log_every
    for tick in range(first, last):
        scheduled = read_record(schedule, build.scheduled, max(tick, 0), schedule.shape[1])
        if tick >= 0:
            time_s = (settings.ticks_before + tick) * substeps * geometry.dt_s
            now = Instant(tick, time_s, 0, settings, geometry, scheduled)
            if settings.driver == BUILT_IN:
                phases.law(arrays, now)
            phases.mix(arrays, now)
            for i in range(len(slots.targets.like.sent_rad_s)):
                for lane in range(n_lanes):
                    sent_rad_s = read_record(w, slots.targets, lane, n_lanes).sent_rad_s
                    arrays.sent[i, position, lane] = sent_rad_s[i]
            position = (
                position + 1 if position + 1 < ring else 0
            )  # a remainder costs a tenth of a tick
            if tick == row * log_every:
                for channel in range(len(arrays.logged)):
                    for lane in range(n_lanes):
                        arrays.log[row, channel, lane] = w[arrays.logged[channel] * n_lanes + lane]
                row += 1
            for part in range(steps):
                if settings.delayed > 0:
                    for lane in range(n_lanes):
                        step = tick * substeps + part
                        apply_delayed_commands(w, lane, n_lanes, arrays.sent, step, substeps, slots)
                phases.move(arrays, Instant(tick, time_s, part, settings, geometry, scheduled))
                if not phases.is_running(arrays):
                    return tick
        time_s = (settings.ticks_before + tick + 1) * substeps * geometry.dt_s
        phases.sense(arrays, Instant(tick + 1, time_s, 0, settings, geometry, scheduled))
    return last


def compile_loop(like: Any, build: Build, phases: Callable[[], Phases], key: str) -> Any:
    """Return the compiled run(arrays, first, last) -> the tick at which it ended.

    Args:
        like: a record of array types; arrays are lent by `lend_rows`.
        key: of everything that the phases depend on.
    """

    def run(arrays: Any, first: Any, last: Any) -> Any:
        return run_ticks(shared_view(arrays, like), first, last, build, phases())

    return compiled_closure(run, key)


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
        loops: named tuple of compiled functions; `run(arrays, first, last)` runs control ticks and
            returns the tick at which the run ended.
        arrays: named tuple of arrays, with a `LoopPlan` as `plan`; change them in place, or
            replace them by `use`.
        rate_Hz: control rate.
    """

    loops: Any
    layout: Layout
    arrays: Any
    lanes: int = 1
    rate_Hz: float
    advance: Callable[[int, int], int]

    def use(self, arrays: Any) -> None:
        """Use these arrays from now on."""
        self.arrays = arrays
        self._table = lend_rows(self.loops.run, arrays)  # keeps what is at its address alive
        table = self._table.ctypes.data if isinstance(self._table, np.ndarray) else arrays
        self.advance = partial(self.loops.run, table)

    def view(self, field: str) -> Array:
        """Return a view of a record or field, for example "hinge.theta_rad" (n, n_lanes)."""
        view: Array = self.arrays.w.reshape(-1, self.lanes)[self.layout.rows(field)]
        return view

    def numbers(self, field: str) -> Any:
        """Return the numbers of one lane; access to one takes half the time of `view`."""
        numbers: Any = self.view(field)[:, 0]
        return memoryview(numbers)

    @abstractmethod
    def measurements(self, times_s: Sequence[float]) -> Iterator[Any]:
        """Yield the current readings for a user-defined controller, with the times of its ticks."""

    @abstractmethod
    def references(self, first: int, last: int) -> Iterator[Any]:
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
        step, write, advance = controller.step, self.write_command, self.advance
        dt_s, n_ticks = 1.0 / self.rate_Hz, last - first
        times_s = (np.arange(ticks_before, ticks_before + n_ticks) / self.rate_Hz).tolist()
        inputs = zip(self.measurements(times_s), self.references(first, last), strict=False)
        for tick, (measurement, reference) in enumerate(inputs, first):
            try:
                command = step(measurement, reference, dt_s)
            except (Exception, SystemExit) as error:
                raise controller_error(controller, error, measurement.time_s) from error
            try:
                write(command)
            except (TypeError, ValueError):
                field, value, remedy = self.invalid_field(command)
                time_s = measurement.time_s
                raise invalid_command_error(controller, field, value, time_s, remedy) from None
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
