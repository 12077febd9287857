"""Find in samples.csv where a run stopped, and mark the samples of visits that were cut short."""

from __future__ import annotations

import os
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from benchtool.core.errors import FileFormatError
from benchtool.core.user_file import open_file
from benchtool.data.atomic import sync_folder
from benchtool.data.columns import LONGEST_S, LONGEST_US

_INTERRUPTED = b"interrupted"


@dataclass(frozen=True, slots=True)
class SamplesFound:
    """Say what samples.csv holds.

    Attributes:
        rows: how many.
        last_s: largest time since the run began; 0 without a row.
        done: visits that have their points.
        from_byte: where the first row stands that belongs to no visit that is done and is not
            marked yet; None where there is none.
    """

    rows: int
    last_s: float
    done: frozenset[int]
    from_byte: int | None


def scan_samples(path: Path, done: frozenset[int]) -> SamplesFound:
    """Return what the samples of a run hold, read line by line.

    Args:
        path: samples.csv; a last line that was cut is left out.
        done: visits that have their points.

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
    return SamplesFound(rows, last_s, done, from_byte)


def write_marked(path: Path, found: SamplesFound) -> None:
    """Write beside the samples what they are with `interrupted` for visits without a point.

    `take_marked` puts it in their place. Nothing but the phase of those rows changes.

    Args:
        path: samples.csv.
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


def take_marked(path: Path) -> None:
    """Put what `write_marked` wrote in place, in one step; nothing where it wrote nothing."""
    with suppress(FileNotFoundError):
        os.replace(_marked(path), path)
        sync_folder(path.parent)


def _marked(path: Path) -> Path:
    return path.with_name(f".{path.name}.marked.new")
