"""Run a campaign in blocks, each stored as it comes: in threads of this process, or on a cluster.

A block is a stretch of the campaign's runs in their order. A worker of a cluster makes the campaign
from its inputs. The same runs under the same seeds give the same rows, wherever a block is run.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache, partial
from pathlib import Path

from benchtool.core.user_code import CodePermit, check_code_allowed
from benchtool.data.run.campaign import write_campaign
from benchtool.simulate.campaign import Campaign, Row
from benchtool.simulate.campaign_flight import flight_campaign
from benchtool.simulate.campaign_pitch import pitch_campaign
from benchtool.simulate.design import Design
from benchtool.simulate.flight.inputs import FlightInputs
from benchtool.simulate.flight.inputs import setup_of as flight_setup_of
from benchtool.simulate.pitch.inputs import PitchInputs
from benchtool.simulate.pitch.inputs import setup_of as pitch_setup_of
from benchtool.tasks import TaskStore, Work, run_tasks

MOST_BLOCKS = 400
FEWEST_RUNS = 50
"""Runs of a block, but for the last: some 0.1 s of pitch runs, against 1 ms that a task costs."""

Block = tuple[int, int]  # First run and one behind the last


def campaign_of(
    inputs: PitchInputs | FlightInputs, permit: CodePermit = check_code_allowed
) -> Campaign:
    """Return the campaign of a command's inputs.

    Args:
        permit: called with a model's own Python before it is run.
    """
    if isinstance(inputs, PitchInputs):
        pitch = {gains: pitch_setup_of(inputs, gains, permit) for gains in inputs.study.gains}
        return pitch_campaign(pitch)
    flight = {gains: flight_setup_of(inputs, gains, permit) for gains in inputs.study.gains}
    return flight_campaign(flight, inputs.controllers or ("oge", "pid"))


def run_campaign(
    campaign: Campaign,
    inputs: PitchInputs | FlightInputs,
    design: Design,
    table: Path,
    metadata: Mapping[str, str],
    written: Callable[[int], None],
) -> int:
    """Run a campaign, write its table, and return its rows.

    Args:
        inputs: of the command; on a cluster, files that they name must be where the workers are.
        written: called with how many runs are done.

    Raises:
        InputError: the blocks that are there belong to another campaign.
    """
    total = design.n_points * design.seeds * len(campaign.setups) * len(campaign.controllers)
    size = max(FEWEST_RUNS, -(-total // MOST_BLOCKS))
    blocks = {str(k): (k, min(k + size, total)) for k in range(0, total, size)}
    about = {**metadata, "runs": str(total), "runs of a block": str(size), "inputs": _said(inputs)}
    cluster = inputs.study.campaign.cluster
    work: Work[Block] = partial(_block_rows, campaign, design)
    if cluster is not None:
        work = partial(_block_rows_of, pickle.dumps(inputs), design)
    done = 0
    with TaskStore(table.with_name("runs.jsonl"), about) as store:
        for _, rows in run_tasks(work, blocks, store=store, cluster=cluster, processes=0):
            done += len(rows)
            written(done)
        write_campaign((row for block in blocks for row in store[block]), table, metadata)
    store.path.unlink()
    return done


def _said(inputs: PitchInputs | FlightInputs) -> str:
    """Return what inputs say of the runs: neither where they run nor where rows are written."""
    study = replace(inputs.study, out=None, campaign=replace(inputs.study.campaign, cluster=None))
    return str(replace(inputs, study=study))


def _block_rows(campaign: Campaign, design: Design, block: Block) -> list[Row]:
    return list(campaign.rows(design, None, *block))


def _block_rows_of(inputs: bytes, design: Design, block: Block) -> list[Row]:
    """Return the rows of a block in a worker, which has one thread for it."""
    return list(_campaign(inputs).rows(design, 1, *block))


@lru_cache(maxsize=4)
def _campaign(inputs: bytes) -> Campaign:
    """Return the campaign of pickled inputs; a worker makes it once for all its blocks."""
    return campaign_of(pickle.loads(inputs))
