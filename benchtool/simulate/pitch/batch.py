"""Many runs of the pitch bench: lanes side by side, cores in parallel, results as they come.

Every run has its own number under the seed and its own stream of noise: what a run gives does not
depend on its neighbours, on the number of lanes or on the number of threads. Blocks are handed on
one by one and then forgotten, so that memory does not grow with the number of runs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import islice
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from benchtool.core.schedule import SampledSchedule
from benchtool.physics.expression import can_compile
from benchtool.simulate.in_order import results_in_order
from benchtool.simulate.pitch.run import PitchJob, PitchLoop

T = TypeVar("T")

LANES = 32
"""Runs side by side: enough that the compiler keeps the loop over them and runs it in vectors, few
enough that their work space stays near the processor. Measured: 16, 24, 32 and 64 lanes take 306,
242, 241 and 246 us for a run of 10 s."""


def simulate_many(
    jobs: Iterable[PitchJob],
    schedule: SampledSchedule,
    take: Callable[[PitchLoop, int, int], T],
    *,
    seed: int = 0,
    first_run: int = 0,
    threads: int | None = None,
    lanes: int | None = None,
    repeat: int | None = None,
) -> Iterator[T]:
    """Yield what `take(loop, lane, run)` makes of every run, in order.

    Args:
        jobs: one per run; all share rig, wake rule and sensor rates.
        schedule: commands, the same for all.
        take: turns a finished lane into a result; called in the thread that ran it. The
            log is written over afterwards: copy what is to stay.
        seed: of the noise.
        first_run: number of the first run under the seed.
        threads: how many at once; all cores when None.
        repeat: begin again with `first_run` after so many runs, so that groups of runs share their
            noise; never when None.
        lanes: runs side by side; `LANES`, or 1 without a compiler, when None.
    """
    width = lanes if lanes is not None else (LANES if can_compile() else 1)
    waiting = iter(jobs)
    spare: list[NDArray[np.float64]] = []  # logs to write into again: fresh memory is slow

    def run_block(block: list[PitchJob], numbers: list[int]) -> list[T]:
        used = len(block)
        filled = block + [block[-1]] * (width - used)
        runs = [*numbers, *[numbers[-1]] * (width - used)]
        log = spare.pop() if spare else None
        loop = PitchLoop(filled, schedule, seed, runs, log=log)
        loop.run()
        taken = [take(loop, lane, numbers[lane]) for lane in range(used)]
        spare.append(loop.log)
        return taken

    def blocks() -> Iterator[Callable[[], list[T]]]:
        number = 0
        while block := list(islice(waiting, width)):
            numbers = [
                first_run + (k % repeat if repeat else k)
                for k in range(number, number + len(block))
            ]
            number += len(block)
            yield partial(run_block, block, numbers)

    for results in results_in_order(blocks(), threads):
        yield from results
