"""Close a run: what a killed process left is mended, the tables made from its samples written.

Every step is one that a second close finds done or does again, so a kill anywhere costs nothing.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchtool.core.counted import counted
from benchtool.data.columns import VALID_KINDS, code_of
from benchtool.data.parquet import seal
from benchtool.data.run.append import Event, EventLog, read_events
from benchtool.data.run.digest import file_hash
from benchtool.data.run.points import write_table
from benchtool.data.run.read import read_points
from benchtool.data.run.sample_stream import WholeLines
from benchtool.data.run.settings import aggregate

if TYPE_CHECKING:
    from benchtool.data.run.run import Run

DIED = "the program that measured it ended without a word (killed, or the power failed)"

LEFT_OVER = re.compile(r"\.[^/]+\.new")
"""Names of files that are being written; where nobody writes, a kill has left them."""


def close_run(run: Run, visits: int | None = None) -> bool:
    """Write what a closed run has and return whether anything was missing.

    A run whose process died is `stopped`, and one that has every point is `ended`. settings.csv
    is made from its points, samples.parquet from its samples, a batch at a time.

    Args:
        run: of any state, measured by nobody now.
        visits: how many the plan has; as the metadata say where left out.

    Raises:
        InputError: another process measures or closes it.
        FileFormatError: a file of it cannot be read.
        OSError: it cannot be written.
    """
    run.check_in_place()
    missing = False
    with run.locked() as log:
        remove_left_overs(run.path)
        before = run.metadata
        changes = _state(run, before, visits, log)
        if _visits_done(run.path):
            settings = run.path / "settings.csv"
            missing = not settings.is_file()
            write_table(settings, aggregate(read_points(run.path)))
        changes |= _seal(run.path, before)
        if changes:
            run.update_metadata(**changes)
    return missing or bool(changes)


def remove_left_overs(folder: Path) -> None:
    """Remove files that a killed process was writing when it should have renamed them."""
    for path in folder.iterdir():
        if LEFT_OVER.fullmatch(path.name) and not path.is_dir():
            path.unlink()


def _state(run: Run, facts: dict[str, Any], visits: int | None, log: EventLog) -> dict[str, Any]:
    """Return what the metadata must say of how the run ended, where they do not."""
    state, planned = facts.get("state"), visits or facts.get("visits")
    if state not in ("running", "stopped"):
        return {}
    done = _visits_done(run.path)
    if planned and done >= int(planned):
        said = f"closed afterwards; all is measured: {counted(done, 'visit')}"
        changes: dict[str, Any] = {"state": "ended"}
    elif state == "running":
        said, changes = f"closed afterwards; {DIED}", {"state": "stopped", "reason": DIED}
    else:
        return {}
    events = read_events(log.path)
    if not events or events[-1].text != said:
        log.append(Event(events[-1].time_s if events else 0.0, "closed", said))
    return changes


def _visits_done(folder: Path) -> int:
    if not has_rows(folder / "points.csv"):
        return 0
    points = read_points(folder, VALID_KINDS)
    visited = points.column("kind") != code_of("kind", "tare")
    return len(np.unique(points.column("point")[visited]))


def _seal(folder: Path, facts: dict[str, Any]) -> dict[str, Any]:
    """Write samples.parquet where it is not that of the samples, and return the new hashes."""
    csv, parquet = folder / "samples.csv", folder / "samples.parquet"
    if not has_rows(csv):
        return {}
    stated, csv_hash = facts.get("samples") or {}, file_hash(csv, follow=False)
    if (
        stated.get("csv_sha256") == csv_hash
        and parquet.is_file()
        and stated.get("parquet_sha256") == file_hash(parquet, follow=False)
    ):
        return {}
    seal(csv, parquet)
    return {"samples": {"parquet_sha256": file_hash(parquet), "csv_sha256": csv_hash}}


def has_rows(path: Path) -> bool:
    """Tell whether a table of a run has a whole row below its header."""
    if not path.is_file():
        return False
    with WholeLines(path) as lines:
        return lines.lines > 0
