"""Campaign: one simulation at many points of a design, in threads or on a cluster.

A block is a range of successive runs and is stored when it is complete. A cluster worker builds the
campaign from its inputs. Rows depend only on run and seed, not on where a block is run.
"""

from __future__ import annotations

import pickle
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import product
from pathlib import Path
from typing import Any

from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.run.campaign import write_campaign
from benchtool.simulate.design import Design
from benchtool.simulate.flight.setup import OGE, flight_setup
from benchtool.simulate.inputs import FlightInputs, PitchInputs
from benchtool.simulate.pitch.setup import pitch_setup
from benchtool.simulate.setup import Row, Setup
from benchtool.tasks import TaskStore, Work, run_tasks

MAX_BLOCKS = 400
MIN_BLOCK_RUNS = 50  # about 0.1 s of pitch runs; a task costs 1 ms

Block = tuple[int, int]  # first run and end (exclusive)


@dataclass(frozen=True, slots=True)
class Campaign:
    """One simulation at many points.

    All points have the same noise: seed k of one point is seed k of any other.

    Attributes:
        setups: by gain set, all of one kind; each is run at every point.
    """

    setups: Mapping[str, Setup]
    controllers: tuple[str, ...]

    @property
    def first(self) -> Setup:
        """Set-up of the first gain set, for title, metadata and measures."""
        return next(iter(self.setups.values()))

    def check(self, design: Design) -> None:
        """Raise if a point of the design cannot be run, before the first run."""
        for setup in self.setups.values():
            for point in design.probes():
                setup.check_point(point, design, self.controllers[0])

    def rows(
        self, design: Design, threads: int | None = None, start: int = 0, stop: int | None = None
    ) -> Iterator[Row]:
        """Yield one row per gain set, controller, point and seed, in that order.

        A row contains the values of the point, `gains`, `controller`, `seed` and the measures.

        Args:
            threads: number of parallel runs; None means all cores.
            start, stop: range of rows.
        """
        labels: deque[Row] = deque()

        def runs() -> Iterator[tuple[Any, int]]:
            groups = product(self.setups.items(), self.controllers, design.points())
            for index, ((gains, setup), controller, point) in enumerate(groups):
                first_row = index * design.seeds
                numbers = range(max(start - first_row, 0), design.seeds)
                if stop is not None:
                    numbers = numbers[: max(stop - max(first_row, start), 0)]
                if not numbers:
                    continue
                run = setup.build_run(controller, point)
                for number in numbers:
                    seed = {"seed": float(design.seed + number)}
                    labels.append({**point, "gains": gains, "controller": controller, **seed})
                    yield run, number

        for measures in self.first.measure_runs(runs(), design.seed, threads):
            yield {**labels.popleft(), **measures}


def build_campaign(
    inputs: PitchInputs | FlightInputs, permit: CodePermit = check_code_allowed
) -> Campaign:
    """Return the campaign of the inputs; `permit` is called before user code of a model is run."""
    if isinstance(inputs, PitchInputs):
        pitch = {gains: pitch_setup(inputs, gains, permit) for gains in inputs.study.gains}
        return Campaign(pitch, inputs.controllers)
    flight = {gains: flight_setup(inputs, gains, permit) for gains in inputs.study.gains}
    return Campaign(flight, inputs.controllers or (OGE, "pid"))


def run_campaign(
    campaign: Campaign,
    inputs: PitchInputs | FlightInputs,
    design: Design,
    table: Path,
    metadata: Mapping[str, str],
    on_progress: Callable[[int], None],
) -> int:
    """Run a campaign, write its table, and return the number of rows.

    Args:
        inputs: on a cluster, the files that they name must exist on the workers.
        on_progress: called with the number of completed runs.

    Raises:
        InputError: the stored blocks belong to another campaign.
    """
    total = design.n_points * design.seeds * len(campaign.setups) * len(campaign.controllers)
    block_size = max(MIN_BLOCK_RUNS, -(-total // MAX_BLOCKS))
    blocks = {
        str(first): (first, min(first + block_size, total)) for first in range(0, total, block_size)
    }
    task_metadata = {
        **metadata,
        "runs": str(total),
        "runs of a block": str(block_size),
        "inputs": _describe_inputs(inputs),
    }
    cluster = inputs.study.campaign.cluster
    work: Work[Block] = partial(_run_block, campaign, design)
    if cluster is not None:
        work = partial(_run_block_in_worker, pickle.dumps(inputs), design)
    done = 0
    with TaskStore(table.with_name("runs.jsonl"), task_metadata) as store:
        for _, rows in run_tasks(work, blocks, store=store, cluster=cluster, processes=0):
            done += len(rows)
            on_progress(done)
        write_campaign((row for block in blocks for row in store[block]), table, metadata)
    store.path.unlink()
    return done


def _describe_inputs(inputs: PitchInputs | FlightInputs) -> str:
    """Return the inputs as text, without output folder and cluster."""
    study = replace(inputs.study, out=None, campaign=replace(inputs.study.campaign, cluster=None))
    return str(replace(inputs, study=study))


def _run_block(campaign: Campaign, design: Design, block: Block) -> list[Row]:
    return list(campaign.rows(design, None, *block))


def _run_block_in_worker(inputs: bytes, design: Design, block: Block) -> list[Row]:
    """Return the rows of a block; a worker has one thread for it."""
    return list(_load_campaign(inputs).rows(design, 1, *block))


@lru_cache(maxsize=4)
def _load_campaign(inputs: bytes) -> Campaign:
    """Return the campaign of pickled inputs, built once per worker."""
    return build_campaign(pickle.loads(inputs))
