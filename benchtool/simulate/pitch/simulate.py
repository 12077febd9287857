"""Runs of the pitch bench: single, with a user-defined controller, or as a batch.

A batch runs in parallel lanes and threads. Every run has its own number and noise stream: its
result does not depend on other runs, on the number of lanes or of threads. Blocks are yielded one
by one, so that memory does not grow with the number of runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import islice
from typing import TypeVar

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.schedule import SampledSchedule
from benchtool.core.units import Array
from benchtool.physics.expression import can_compile
from benchtool.simulate.controllers.controller import (
    Controller,
    PitchCommand,
    PitchMeasurement,
    PitchReference,
)
from benchtool.simulate.loop import results_in_order
from benchtool.simulate.pitch.result import PitchRun
from benchtool.simulate.pitch.run import PitchJob, PitchLoop

PitchController = Controller[PitchMeasurement, PitchReference, PitchCommand | float]

T = TypeVar("T")

# Enough lanes for vectorisation, few enough for the processor cache. Measured: 16, 24, 32 and 64
# lanes take 306, 242, 241 and 246 us for a run of 10 s.
LANES = 32


def simulate_pitch(
    job: PitchJob, schedule: SampledSchedule, seed: int = 0, run: int = 0
) -> PitchRun:
    """Return one run with a built-in controller; run 3 of seed 7 is the same in any batch."""
    loop = PitchLoop([job], schedule, seed, [run])
    loop.run()
    return extract_run(loop, 0, job.control.name)


def simulate_controller(
    controller: PitchController,
    job: PitchJob,
    schedule: SampledSchedule,
    seed: int = 0,
    name: str = "own",
) -> PitchRun:
    """Return one run with a user-defined controller.

    At every control tick it gets the readings and returns a `PitchCommand` or a torque in N m.
    Feedforward and mixer are those of `job.control`.

    Raises:
        InputError: the controller raised, or returned numbers that are not finite.
    """
    loop = PitchLoop([job], schedule, seed, [0], external=True)
    loop.run_controller(controller, 0, len(schedule))
    return extract_run(loop, 0, name)


def extract_run(loop: PitchLoop, lane: int, name: str) -> PitchRun:
    """Return the run of one lane of a finished loop."""
    log = np.ascontiguousarray(loop.log[:, :, lane])
    if not np.isfinite(log).all():
        tick = int(np.argmax(~np.isfinite(log).all(axis=1)))
        raise InputError(
            f"the simulation of {name!r} is not finite from "
            f"{tick / loop.schedule.rate_Hz:g} s; check gains and parameters"
        )
    return PitchRun(
        controller=name,
        rate_Hz=loop.schedule.rate_Hz,
        log=log,
        clamped_steps=int(loop.view("hinge.clamped_steps")[0, lane]),
        stopped_steps=int(loop.view("hinge.stopped_steps")[0, lane]),
    )


def simulate_many(
    jobs: Iterable[tuple[PitchJob, int]],
    schedule: SampledSchedule,
    take: Callable[[PitchLoop, int, int], T],
    *,
    seed: int = 0,
    threads: int | None = None,
    lanes: int | None = None,
) -> Iterator[T]:
    """Yield the result `take(loop, lane, run)` of every run, in order.

    Args:
        jobs: jobs with their run numbers; all share rig, wake rule and sensor rates.
        take: called in the thread of the run. The log is overwritten afterwards and must be copied.
        threads: number of parallel threads; None means all cores.
        lanes: runs per loop; None means `LANES`, or 1 without a compiler.
    """
    width = lanes if lanes is not None else (LANES if can_compile() else 1)
    remaining = iter(jobs)
    free_logs: list[Array] = []  # reused, because new memory is slow

    def run_block(block: list[tuple[PitchJob, int]]) -> list[T]:
        lane_jobs, runs = zip(*block, *[block[-1]] * (width - len(block)), strict=True)
        log = free_logs.pop() if free_logs else None
        loop = PitchLoop(lane_jobs, schedule, seed, runs, log=log)
        loop.run()
        block_results = [take(loop, lane, runs[lane]) for lane in range(len(block))]
        free_logs.append(loop.log)
        return block_results

    blocks = iter(lambda: list(islice(remaining, width)), [])
    for results in results_in_order((partial(run_block, block) for block in blocks), threads):
        yield from results
