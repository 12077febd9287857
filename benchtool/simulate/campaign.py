"""Campaign: one simulation at many points, in a grid or at random, in threads or on a cluster.

A block is a range of successive runs and is stored when it is complete. A cluster worker builds the
campaign from its inputs. Rows depend only on run and seed, not on where a block is run.
"""

from __future__ import annotations

import pickle
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from itertools import product
from math import isfinite, prod
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.errors import InputError
from benchtool.core.text import pluralize
from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.parquet import write_campaign
from benchtool.simulate.flight.setup import OGE, flight_setup
from benchtool.simulate.inputs import FlightInputs, PitchInputs, Row, Setup
from benchtool.simulate.pitch.setup import pitch_setup
from benchtool.tasks import TaskStore, Work, run_tasks

MAX_RUNS = 10_000_000  # about an hour of pitch runs; larger designs are typing errors; assumed
MAX_BLOCKS = 400
MIN_BLOCK_RUNS = 50  # about 0.1 s of pitch runs; a task costs 1 ms

Block = tuple[int, int]  # first run and end (exclusive)


@dataclass(frozen=True, slots=True)
class VariedParameter:
    """Parameter varied from `lower` to `upper`, with `count` values in a grid."""

    name: str
    lower: float
    upper: float
    count: int

    def __post_init__(self) -> None:
        if self.lower > self.upper or (self.lower == self.upper) != (self.count == 1):
            raise InputError(
                f"range of {self.name} is invalid: {self.lower:g} to {self.upper:g}, {self.count} "
                f"values; allowed: FROM below TO and COUNT from 2, or FROM equal to TO and COUNT 1"
            )

    @classmethod
    def read(cls, text: str) -> VariedParameter:
        """Return the varied parameter in the text `NAME=FROM:TO:COUNT`."""
        name, _, numbers = text.partition("=")
        parts = numbers.split(":")
        try:
            lower, upper, count = float(parts[0]), float(parts[1]), int(parts[2])
        except (ValueError, IndexError):
            count = 0
            lower = upper = float("nan")
        if len(parts) != 3 or not name or not (isfinite(lower) and isfinite(upper)) or count < 1:
            raise InputError(f"--vary got {text!r}; write NAME=FROM:TO:COUNT, such as K_b=1:2:11")
        return cls(name.strip(), lower, upper, count)

    def values(self) -> list[float]:
        """Return the values of the grid."""
        return [float(value) for value in np.linspace(self.lower, self.upper, self.count)]


@dataclass(frozen=True, slots=True, kw_only=True)
class Design:
    """Points of a campaign.

    Attributes:
        samples: number of random points within the ranges; 0 means the grid.
        seeds: number of noise seeds per point.
    """

    varied: tuple[VariedParameter, ...]
    samples: int = 0
    seeds: int = 1
    seed: int = 0

    def __post_init__(self) -> None:
        names = [parameter.name for parameter in self.varied]
        if not names:
            raise InputError("a campaign needs a varied parameter; add --vary NAME=FROM:TO:COUNT")
        if len(set(names)) != len(names):
            raise InputError("a parameter occurs twice in --vary; give it once")
        if self.seeds < 1 or self.samples < 0:
            raise InputError(
                f"{self.seeds} seeds and {self.samples} samples are out of range; allowed: seeds "
                f"from 1, samples from 0 (a grid)"
            )
        if self.n_points * self.seeds > MAX_RUNS:
            raise InputError(
                f"{pluralize(self.n_points, 'point')} with {pluralize(self.seeds, 'seed')} are "
                f"{self.n_points * self.seeds} runs; allowed: up to {MAX_RUNS}"
            )

    @classmethod
    def read(
        cls,
        texts: Sequence[str],
        *,
        samples: int = 0,
        seeds: int = 1,
        seed: int = 0,
        full_name: Callable[[str], str] = str,
    ) -> Design:
        """Return the design of `NAME=FROM:TO:COUNT` texts; `full_name` completes each name."""
        parameters = [VariedParameter.read(text) for text in texts]
        varied = tuple(replace(v, name=full_name(v.name)) for v in parameters)
        return cls(varied=varied, samples=samples, seeds=seeds, seed=seed)

    @property
    def n_points(self) -> int:
        """Number of points."""
        return self.samples or prod(parameter.count for parameter in self.varied)

    @property
    def names(self) -> list[str]:
        """Names of the varied parameters."""
        return [parameter.name for parameter in self.varied]

    def points(self) -> Iterator[dict[str, float]]:
        """Yield the points: the full grid, or random ones."""
        if not self.samples:
            for values in product(*(parameter.values() for parameter in self.varied)):
                yield dict(zip(self.names, values, strict=True))
            return
        rng = np.random.default_rng(self.seed)
        for _ in range(self.samples):
            yield {v.name: float(rng.uniform(v.lower, v.upper)) for v in self.varied}

    def probes(self) -> Iterator[dict[str, float]]:
        """Yield the points that are checked before a campaign: corners, and every single value."""
        ends = [sorted({parameter.lower, parameter.upper}) for parameter in self.varied]
        for values in product(*ends):
            yield dict(zip(self.names, values, strict=True))
        lowest = {parameter.name: parameter.lower for parameter in self.varied}
        for parameter in self.varied:
            for value in parameter.values()[1:-1]:
                yield lowest | {parameter.name: value}

    def to_metadata(self) -> dict[str, str]:
        """Return the design as metadata of the table file."""
        ranges = {f"vary.{v.name}": f"{v.lower:g}:{v.upper:g}:{v.count}" for v in self.varied}
        return ranges | {
            "samples": str(self.samples), "seeds": str(self.seeds), "seed": str(self.seed),
        }  # fmt: skip

    def describe(self) -> str:
        """Return the number of points as text."""
        if self.samples:
            points = f"{self.samples} random points of {' and '.join(self.names)}"
        else:
            points = " x ".join(f"{parameter.count} {parameter.name}" for parameter in self.varied)
        return points + (f", {self.seeds} seeds" if self.seeds > 1 else "")


@dataclass(frozen=True, slots=True)
class Campaign:
    """Simulations of set-ups by gain set, all of one kind, at many points.

    All points have the same noise: seed k of one point is seed k of any other.
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
                setup.check_point(point, design.names, design.seeds, self.controllers[0])

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
    cluster = inputs.study.campaign.cluster
    study = replace(inputs.study, out=None, campaign=replace(inputs.study.campaign, cluster=None))
    task_metadata = {
        **metadata,
        "runs": str(total),
        "runs of a block": str(block_size),
        "inputs": str(replace(inputs, study=study)),
    }
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


def _run_block(
    campaign: Campaign, design: Design, block: Block, threads: int | None = None
) -> list[Row]:
    return list(campaign.rows(design, threads, *block))


def _run_block_in_worker(inputs: bytes, design: Design, block: Block) -> list[Row]:
    """Return the rows of a block; a worker has one thread for it."""
    return _run_block(_load_campaign(inputs), design, block, 1)


@lru_cache(maxsize=4)
def _load_campaign(inputs: bytes) -> Campaign:
    """Return the campaign of pickled inputs, built once per worker."""
    return build_campaign(pickle.loads(inputs))
