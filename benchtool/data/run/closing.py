"""Closing of a run: repairs after a killed process, tables derived from points and samples.

Every step is idempotent, so closing can be killed at any time and repeated.
"""

from __future__ import annotations

import os
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from benchtool.core.errors import FileFormatError
from benchtool.core.text import pluralize
from benchtool.core.user_file import open_file
from benchtool.data.atomic import file_hash, sync_folder
from benchtool.data.columns import MAX_DEVICE_TIME_US, MAX_RUN_DURATION_S, VALID_KINDS, word_to_code
from benchtool.data.parquet import finalize_parquet, scan_lines
from benchtool.data.run.append import Event, EventLog, read_events
from benchtool.data.run.points import write_table
from benchtool.data.run.read import read_points
from benchtool.data.run.settings import load_settings

if TYPE_CHECKING:
    from benchtool.data.run.run import Run

ENDED_UNEXPECTEDLY = "the program that measured it ended unexpectedly (killed, or the power failed)"

LEFTOVER_PATTERN = re.compile(r"\.[^/]+\.new")  # temporary files of a killed writer


def close_run(run: Run, n_planned: int | None = None) -> bool:
    """Write the files and metadata of a closed run; return whether anything was missing.

    The state becomes `ended` if every point is measured, else `stopped` after an unexpected exit.
    settings.csv is derived from points.csv, samples.parquet in batches from samples.csv.

    Args:
        n_planned: number of points in the plan; default: from the metadata.

    Raises:
        InputError: another process measures or closes the run.
        FileFormatError: a file of the run cannot be read.
        OSError: the run cannot be written.
    """
    run.check_in_place()
    missing = False
    with run.locked() as log:
        remove_leftovers(run.path)
        before = run.metadata
        changes = _final_state(run, before, n_planned, log)
        if _count_measured(run.path):
            settings = run.path / "settings.csv"
            missing = not settings.is_file()
            write_table(settings, load_settings(run.path))
        changes |= _seal(run.path, before)
        points = run.path / "points.csv"
        unsealed = missing or changes or not before.get("samples")
        if unsealed and not before.get("points") and has_rows(points):
            changes["points"] = {"csv_sha256": file_hash(points, follow=False)}
        if changes:
            run.update_metadata(**changes)
    return missing or bool(changes)


def remove_leftovers(folder: Path) -> None:
    """Remove temporary files of a killed process."""
    for path in folder.iterdir():
        if LEFTOVER_PATTERN.fullmatch(path.name) and not path.is_dir():
            path.unlink()


def _final_state(
    run: Run, metadata: dict[str, Any], n_planned: int | None, log: EventLog
) -> dict[str, Any]:
    """Return the changes of state and reason in the metadata; log them as an event."""
    state, planned = metadata.get("state"), n_planned or metadata.get("visits")
    if state not in ("running", "stopped"):
        return {}
    measured = _count_measured(run.path)
    if planned and measured >= int(planned):
        text = f"closed afterwards; all is measured: {pluralize(measured, 'visit')}"
        changes: dict[str, Any] = {"state": "ended"}
    elif state == "running":
        text = f"closed afterwards; {ENDED_UNEXPECTEDLY}"
        changes = {"state": "stopped", "reason": ENDED_UNEXPECTEDLY}
    else:
        return {}
    events = read_events(log.path)
    if not events or events[-1].text != text:
        log.append(Event(events[-1].time_s if events else 0.0, "closed", text))
    return changes


def _count_measured(folder: Path) -> int:
    if not has_rows(folder / "points.csv"):
        return 0
    points = read_points(folder, VALID_KINDS)
    measured = points.column("kind") != word_to_code("kind", "tare")
    return len(np.unique(points.column("point")[measured]))


def _seal(folder: Path, metadata: dict[str, Any]) -> dict[str, Any]:
    """Write samples.parquet unless it is up to date; return its new hashes, {} if unchanged."""
    csv, parquet = folder / "samples.csv", folder / "samples.parquet"
    if not has_rows(csv):
        return {}
    hashes, csv_hash = metadata.get("samples") or {}, file_hash(csv, follow=False)
    if (
        hashes.get("csv_sha256") == csv_hash
        and parquet.is_file()
        and hashes.get("parquet_sha256") == file_hash(parquet, follow=False)
    ):
        return {}
    finalize_parquet(csv, parquet, csv_hash)
    return {"samples": {"parquet_sha256": file_hash(parquet), "csv_sha256": csv_hash}}


def has_rows(path: Path) -> bool:
    """Return whether a table has a complete row below its header."""
    if not path.is_file():
        return False
    return scan_lines(path)[0] > 0


_INTERRUPTED = b"interrupted"


@dataclass(frozen=True, slots=True)
class SampleScan:
    """Number of rows, end time and unmeasured points of samples.csv."""

    rows: int
    last_s: float  # latest time since the start of the run; 0 without rows
    measured: frozenset[int]  # numbers of the measured points
    unmarked_offset: int | None  # of the first row to mark as interrupted; None if there is none


def scan_samples(path: Path, measured: frozenset[int]) -> SampleScan:
    """Read samples.csv line by line and return a summary; ignore an incomplete last line."""
    rows, last_s, unmarked_offset = 0, 0.0, None
    finished = {b"0", *(str(point).encode() for point in measured)}
    with open_file(path, follow=False) as file:
        offset = len(file.readline())
        for number, line in enumerate(file, 2):
            if not line.endswith(b"\n"):
                break
            cells = line.split(b",", 4)
            try:
                time_s, point, phase = float(cells[0]), cells[2], cells[3]
                device_us = float(cells[1])
                in_range = (
                    abs(time_s) <= MAX_RUN_DURATION_S and abs(device_us) <= MAX_DEVICE_TIME_US
                )
                if not (in_range and point.isdigit()):
                    raise ValueError
            except (ValueError, IndexError):
                raise FileFormatError(
                    f"{path}, line {number}",
                    f"it starts with {line[:40].decode('utf-8', 'replace').strip()!r}; expected: "
                    f"finite time_s, device time, point and phase; correct or delete that line",
                ) from None
            rows += 1
            last_s = max(last_s, time_s)
            if unmarked_offset is None and point not in finished and phase != _INTERRUPTED:
                unmarked_offset = offset
            offset += len(line)
    return SampleScan(rows, last_s, measured, unmarked_offset)


def write_marked_samples(path: Path, scan: SampleScan) -> None:
    """Write a copy of samples.csv with phase `interrupted` in rows of unmeasured points.

    No other cell changes; `install_marked_samples` replaces the original with the copy.
    """
    if scan.unmarked_offset is None:
        return
    finished = {b"0", *(str(point).encode() for point in scan.measured)}
    with open_file(path, follow=False) as old, open(_marked_path(path), "xb") as new:
        remaining = scan.unmarked_offset
        while remaining and (block := old.read(min(remaining, 1 << 20))):
            new.write(block)
            remaining -= len(block)
        for line in old:
            cells = line.split(b",", 4)
            interrupted = len(cells) == 5 and cells[2] not in finished and line.endswith(b"\n")
            new.write(b",".join([*cells[:3], _INTERRUPTED, cells[4]]) if interrupted else line)
        new.flush()
        os.fsync(new.fileno())


def install_marked_samples(path: Path) -> None:
    """Replace samples.csv atomically with the copy of `write_marked_samples`, if there is one."""
    with suppress(FileNotFoundError):
        os.replace(_marked_path(path), path)
        sync_folder(path.parent)


def _marked_path(path: Path) -> Path:
    return path.with_name(f".{path.name}.marked.new")
