"""Campaigns on a Dask cluster: blocks of runs, each stored as it comes, so that none is run twice.

A block is a stretch of the campaign's runs in their order. A worker makes the campaign from its
inputs and runs the block: the same runs under the same seeds give the same rows, so that a block
whose worker died is run again elsewhere. What the client stored stays when the scheduler or the
client itself ends; the same command then runs the blocks that are missing.
"""

from __future__ import annotations

import hashlib
import logging
import shutil
import socket
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from benchtool.core.errors import InputError, LinkLost
from benchtool.core.own_code import CodePermit, refuse_code
from benchtool.data.atomic import read_json, replace_json
from benchtool.data.run.campaign import CampaignWriter, join_campaign
from benchtool.simulate.campaign import Campaign, Row
from benchtool.simulate.campaign_flight import flight_campaign
from benchtool.simulate.campaign_pitch import pitch_campaign
from benchtool.simulate.design import Design
from benchtool.simulate.flight.inputs import FlightInputs
from benchtool.simulate.flight.inputs import setup_of as flight_setup_of
from benchtool.simulate.pitch.inputs import PitchInputs
from benchtool.simulate.pitch.inputs import setup_of as pitch_setup_of

if TYPE_CHECKING:
    from distributed import Client

MOST_BLOCKS = 400
FEWEST_RUNS = 50
"""Runs of a block, but for the last: some 0.1 s of pitch runs, against 1 ms that a task costs."""

REACHED_S = 10.0
"""Time in which a scheduler must answer."""

Note = Callable[[tuple[str, ...]], None]


def campaign_of(
    inputs: PitchInputs | FlightInputs,
    permit: CodePermit = refuse_code,
    note: Note = lambda notes: None,
) -> Campaign:
    """Return the campaign of a command's inputs.

    Args:
        permit: called with a model's own Python before it is run.
        note: called with how a model's file was read.
    """
    if isinstance(inputs, PitchInputs):
        pitch = {gains: pitch_setup_of(inputs, gains, permit) for gains in inputs.study.gains}
        for setup in pitch.values():
            note(setup.notes)
        return pitch_campaign(pitch)
    flight = {
        gains: flight_setup_of(inputs, gains, permit, lambda notes: note(tuple(notes)))
        for gains in inputs.study.gains
    }
    return flight_campaign(flight, inputs.controllers or ("oge", "pid"))


def run_on_cluster(
    address: str,
    inputs: PitchInputs | FlightInputs,
    design: Design,
    table: Path,
    metadata: Mapping[str, str],
    total: int,
    written: Callable[[int], None],
) -> int:
    """Run a campaign on the workers of a scheduler, write its table, and return its rows.

    Args:
        address: of the scheduler, as tcp://127.0.0.1:8786.
        inputs: of the command; files that they name must be where the workers are, too.
        table: Parquet file; finished blocks are in the folder `blocks` beside it until it is there.
        metadata: of the table.
        total: how many runs there are.
        written: called with how many are done.

    Raises:
        InputError: Dask is missing, the scheduler does not answer, or the blocks that are there
            belong to another campaign.
        LinkLost: the scheduler was lost; finished blocks stay.
    """
    client = _client(address)
    folder = table.with_name("blocks")
    size = max(FEWEST_RUNS, -(-total // MOST_BLOCKS))
    _claim(
        folder,
        {**metadata, "runs": str(total), "runs of a block": str(size), "inputs": _said(inputs)},
    )
    blocks = {
        folder / f"{start:08d}.parquet": (start, min(start + size, total))
        for start in range(0, total, size)
    }
    missing = {path: block for path, block in blocks.items() if not path.exists()}
    done = total - sum(stop - start for start, stop in missing.values())
    written(done)
    with client:
        for path, rows in _results(client, address, inputs, design, missing, folder):
            # A process that ended while it wrote leaves a part, which is written anew.
            path.with_name(f"{path.name}.part").unlink(missing_ok=True)
            with CampaignWriter(path, {}) as writer:
                for row in rows:
                    writer.add(row)
            done += len(rows)
            written(done)
    join_campaign(list(blocks), table, metadata)
    shutil.rmtree(folder)
    return done


def _said(inputs: PitchInputs | FlightInputs) -> str:
    """Return what inputs say of the runs: neither where they run nor where rows are written."""
    study = replace(inputs.study, out=None, campaign=replace(inputs.study.campaign, cluster=None))
    return str(replace(inputs, study=study))


def _client(address: str) -> Client:
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "--cluster needs Dask, which is not installed; pip install benchtool[cluster]"
        ) from None
    # What goes wrong is said in a sentence of our own.
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    place = urlsplit(address)
    try:
        # Dask's own attempt leaves threads behind that complain at the end.
        with socket.create_connection((place.hostname or "", place.port or 0), REACHED_S):
            pass
        return Client(address, timeout=REACHED_S, set_as_default=False)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise InputError(
            f"no Dask scheduler answers at {address} ({error}); start one with: dask scheduler, "
            f"workers with: dask worker tcp://HOST:8786, and name it as --cluster tcp://HOST:8786"
        ) from error


def _claim(folder: Path, about: Mapping[str, str]) -> None:
    """Make the folder of blocks, or see that those in it are of the same campaign."""
    path = folder / "campaign.json"
    if not path.exists():
        folder.mkdir(parents=True, exist_ok=True)
        replace_json(path, about)
    elif (found := read_json(path)) != dict(about):
        changed = sorted(key for key in {*found, *about} if found.get(key) != about.get(key))
        raise InputError(
            f"{folder} holds blocks of another campaign ({', '.join(changed)} differ); name "
            f"another folder with --out, or repeat the command that began it"
        )


def _results(
    client: Client,
    address: str,
    inputs: PitchInputs | FlightInputs,
    design: Design,
    missing: Mapping[Path, tuple[int, int]],
    folder: Path,
) -> Any:
    from distributed import as_completed
    from distributed.client import FutureCancelledError
    from distributed.scheduler import KilledWorker

    about = hashlib.sha256(f"{folder.resolve()} {_said(inputs)}".encode()).hexdigest()
    futures = {
        client.submit(block_rows, inputs, design, *block, key=f"benchtool-{about[:16]}-{block[0]}"):
        path for path, block in missing.items()
    }  # fmt: skip
    try:
        done = as_completed(futures, loop=client.loop)  # type: ignore[no-untyped-call]
        for future in done:
            yield futures[future], future.result()
            future.release()  # the scheduler need not hold what is on the disk
    except KilledWorker as error:
        raise LinkLost(
            f"workers of {address} died several times at one block ({error}); what is finished is "
            f"in {folder}; look at the workers, and repeat the command"
        ) from error
    except (FutureCancelledError, OSError, TimeoutError) as error:
        raise LinkLost(
            f"the scheduler at {address} was lost; what is finished is in {folder}; start a "
            f"scheduler and workers again, and repeat the command"
        ) from error


def block_rows(
    inputs: PitchInputs | FlightInputs, design: Design, start: int, stop: int
) -> list[Row]:
    """Return the rows of some of a campaign's runs, in their order; called in a worker.

    Args:
        start: first run.
        stop: one behind the last.
    """
    return list(_campaign(_Same(inputs)).rows(design, 1, start, stop))


class _Same:
    """Inputs by what they say, so that a worker makes a campaign once for all its blocks."""

    def __init__(self, inputs: PitchInputs | FlightInputs) -> None:
        self.inputs = inputs

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self.inputs == other.inputs

    def __hash__(self) -> int:
        return hash(str(self.inputs))


@lru_cache(maxsize=4)
def _campaign(same: _Same) -> Campaign:
    return campaign_of(same.inputs)
