"""Close a run: what a killed process left is mended, the tables made from its samples written.

Every step is one that a second close finds done or does again, so a kill anywhere costs nothing.
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
from benchtool.core.plural import pluralize
from benchtool.core.user_file import open_file
from benchtool.data.atomic import file_hash, sync_folder
from benchtool.data.columns import LONGEST_S, LONGEST_US, VALID_KINDS, word_to_code
from benchtool.data.parquet import finalize_parquet
from benchtool.data.run.append import Event, EventLog, read_events
from benchtool.data.run.points import write_table
from benchtool.data.run.read import read_points
from benchtool.data.run.sample_stream import WholeLines
from benchtool.data.run.settings import load_settings

if TYPE_CHECKING:
    from benchtool.data.run.run import Run

ENDED_UNEXPECTEDLY = (
    "the program that measured it ended without a word (killed, or the power failed)"
)

LEFTOVER_PATTERN = re.compile(r"\.[^/]+\.new")  # of a writer that was killed


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
        remove_leftovers(run.path)
        before = run.metadata
        changes = _state(run, before, visits, log)
        if _visits_done(run.path):
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
    """Remove files that a killed process was writing when it should have renamed them."""
    for path in folder.iterdir():
        if LEFTOVER_PATTERN.fullmatch(path.name) and not path.is_dir():
            path.unlink()


def _state(run: Run, facts: dict[str, Any], visits: int | None, log: EventLog) -> dict[str, Any]:
    """Return what the metadata must say of how the run ended, where they do not."""
    state, planned = facts.get("state"), visits or facts.get("visits")
    if state not in ("running", "stopped"):
        return {}
    done = _visits_done(run.path)
    if planned and done >= int(planned):
        text = f"closed afterwards; all is measured: {pluralize(done, 'visit')}"
        changes: dict[str, Any] = {"state": "ended"}
    elif state == "running":
        text, changes = (
            f"closed afterwards; {ENDED_UNEXPECTEDLY}",
            {"state": "stopped", "reason": ENDED_UNEXPECTEDLY},
        )
    else:
        return {}
    events = read_events(log.path)
    if not events or events[-1].text != text:
        log.append(Event(events[-1].time_s if events else 0.0, "closed", text))
    return changes


def _visits_done(folder: Path) -> int:
    if not has_rows(folder / "points.csv"):
        return 0
    points = read_points(folder, VALID_KINDS)
    visited = points.column("kind") != word_to_code("kind", "tare")
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
    finalize_parquet(csv, parquet, csv_hash)
    return {"samples": {"parquet_sha256": file_hash(parquet), "csv_sha256": csv_hash}}


def has_rows(path: Path) -> bool:
    """Return whether a table of a run has a whole row below its header."""
    if not path.is_file():
        return False
    with WholeLines(path) as lines:
        return lines.lines > 0


_INTERRUPTED = b"interrupted"


@dataclass(frozen=True, slots=True)
class SampleScan:
    """Say what samples.csv holds.

    Attributes:
        last_s: largest time since the run began; 0 without a row.
        from_byte: where the first row stands that belongs to no visit that is done and is not
            marked yet; None where there is none.
    """

    rows: int
    last_s: float
    done: frozenset[int]
    from_byte: int | None


def scan_samples(path: Path, done: frozenset[int]) -> SampleScan:
    """Return what the samples of a run hold, read line by line.

    Args:
        path: samples.csv; a last line that was cut is left out.

    Raises:
        FileFormatError: a line that no writer of ours has written.
    """
    rows, last_s, from_byte = 0, 0.0, None
    finished = {b"0", *(str(point).encode() for point in done)}
    with open_file(path, follow=False) as file:
        at = len(file.readline())
        for number, line in enumerate(file, 2):
            if not line.endswith(b"\n"):
                break
            cells = line.split(b",", 4)
            try:
                time_s, point, phase = float(cells[0]), cells[2], cells[3]
                device_us = float(cells[1])
                in_range = abs(time_s) <= LONGEST_S and abs(device_us) <= LONGEST_US
                if not (in_range and point.isdigit()):
                    raise ValueError
            except (ValueError, IndexError):
                raise FileFormatError(
                    f"{path}, line {number}",
                    f"it begins with {line[:40].decode('utf-8', 'replace').strip()!r}, where a "
                    f"finite time_s, the device's time, a visit and a phase must stand; mend or "
                    f"delete that line",
                ) from None
            rows += 1
            last_s = max(last_s, time_s)
            if from_byte is None and point not in finished and phase != _INTERRUPTED:
                from_byte = at
            at += len(line)
    return SampleScan(rows, last_s, done, from_byte)


def write_marker(path: Path, found: SampleScan) -> None:
    """Write beside the samples what they are with `interrupted` for visits without a point.

    `read_marker` puts it in their place. Nothing but the phase of those rows changes.

    Args:
        found: by `scan_samples`, in the file as it is.
    """
    if found.from_byte is None:
        return
    finished = {b"0", *(str(point).encode() for point in found.done)}
    with open_file(path, follow=False) as old, open(_marked(path), "xb") as new:
        left = found.from_byte
        while left and (part := old.read(min(left, 1 << 20))):
            new.write(part)
            left -= len(part)
        for line in old:
            cells = line.split(b",", 4)
            marked = len(cells) == 5 and cells[2] not in finished and line.endswith(b"\n")
            new.write(b",".join([*cells[:3], _INTERRUPTED, cells[4]]) if marked else line)
        new.flush()
        os.fsync(new.fileno())


def read_marker(path: Path) -> None:
    """Put what `write_marker` wrote in place, in one step; nothing where it wrote nothing."""
    with suppress(FileNotFoundError):
        os.replace(_marked(path), path)
        sync_folder(path.parent)


def _marked(path: Path) -> Path:
    return path.with_name(f".{path.name}.marked.new")
