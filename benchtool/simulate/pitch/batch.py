"""Batch of runs of the pitch bench, in parallel lanes and threads.

Every run has its own number and noise stream: its result does not depend on other runs, on the
number of lanes or of threads. Blocks are yielded one by one, so that memory does not grow with the
number of runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import islice
from typing import TypeVar

from benchtool.core.schedule import SampledSchedule
from benchtool.core.units import Array
from benchtool.physics.expression import can_compile
from benchtool.simulate.campaign import results_in_order
from benchtool.simulate.pitch.run import PitchJob, PitchLoop

T = TypeVar("T")

# Enough lanes for vectorisation, few enough for the processor cache. Measured: 16, 24, 32 and 64
# lanes take 306, 242, 241 and 246 us for a run of 10 s.
LANES = 32


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
