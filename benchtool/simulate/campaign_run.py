"""Campaign execution in blocks: in threads of this process or on a cluster.

A block is a range of successive runs and is stored when it is complete. A cluster worker builds the
campaign from its inputs. Rows depend only on run and seed, not on where a block is run.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.parquet import write_campaign
from benchtool.simulate.campaign import Campaign, Row
from benchtool.simulate.campaign_flight import flight_campaign
from benchtool.simulate.campaign_pitch import pitch_campaign
from benchtool.simulate.design import Design
from benchtool.simulate.flight.inputs import FlightInputs
from benchtool.simulate.flight.inputs import build_setup as build_flight_setup
from benchtool.simulate.pitch.inputs import PitchInputs
from benchtool.simulate.pitch.inputs import build_setup as build_pitch_setup
from benchtool.tasks import TaskStore, Work, run_tasks

MAX_BLOCKS = 400
MIN_BLOCK_RUNS = 50  # about 0.1 s of pitch runs; a task costs 1 ms

Block = tuple[int, int]  # first run and end (exclusive)


def build_campaign(
    inputs: PitchInputs | FlightInputs, permit: CodePermit = check_code_allowed
) -> Campaign:
    """Return the campaign of the inputs; `permit` is called before user code of a model is run."""
    if isinstance(inputs, PitchInputs):
        pitch = {gains: build_pitch_setup(inputs, gains, permit) for gains in inputs.study.gains}
        return pitch_campaign(pitch)
    flight = {gains: build_flight_setup(inputs, gains, permit) for gains in inputs.study.gains}
    return flight_campaign(flight, inputs.controllers or ("oge", "pid"))


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
