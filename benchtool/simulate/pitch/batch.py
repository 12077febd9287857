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

from benchtool.core.array_type import Array
from benchtool.core.schedule import SampledSchedule
from benchtool.physics.expression import can_compile
from benchtool.simulate.campaign import results_in_order
from benchtool.simulate.pitch.run import PitchJob, PitchLoop

T = TypeVar("T")

LANES = 32
"""Runs side by side: enough that the compiler keeps the loop over them and runs it in vectors, few
enough that their work space stays near the processor. Measured: 16, 24, 32 and 64 lanes take 306,
242, 241 and 246 us for a run of 10 s."""


def simulate_many(
    jobs: Iterable[tuple[PitchJob, int]],
    schedule: SampledSchedule,
    take: Callable[[PitchLoop, int, int], T],
    *,
    seed: int = 0,
    threads: int | None = None,
    lanes: int | None = None,
) -> Iterator[T]:
    """Yield what `take(loop, lane, run)` makes of every run, in order.

    Args:
        jobs: what is run, with the number of the run under the seed; all share rig, wake rule and
            sensor rates.
        take: turns a finished lane into a result; called in the thread that ran it. The
            log is written over afterwards: copy what is to stay.
        threads: how many at once; all cores when None.
        lanes: runs side by side; `LANES`, or 1 without a compiler, when None.
    """
    width = lanes if lanes is not None else (LANES if can_compile() else 1)
    waiting = iter(jobs)
    spare: list[Array] = []  # logs to write into again: fresh memory is slow

    def run_block(block: list[tuple[PitchJob, int]]) -> list[T]:
        filled, runs = zip(*block, *[block[-1]] * (width - len(block)), strict=True)
        log = spare.pop() if spare else None
        loop = PitchLoop(filled, schedule, seed, runs, log=log)
        loop.run()
        taken = [take(loop, lane, runs[lane]) for lane in range(len(block))]
        spare.append(loop.log)
        return taken

    blocks = iter(lambda: list(islice(waiting, width)), [])
    for results in results_in_order((partial(run_block, block) for block in blocks), threads):
        yield from results
