"""Catalogue entries: metadata of a run, result or file for lists and filters."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Literal, get_args

EntryKind = Literal[  # a recording is a file with a JSON file, a table any other CSV file
    "sweep",
    "live recording",
    "pitch recording",
    "fit",
    "explanation",
    "recording",
    "table",
    "unknown",
]

SWEEPS = ("sweep", "live recording")  # runs with points: by a plan, or of manual operation

ENTRY_KINDS: tuple[str, ...] = get_args(EntryKind)

FIT_FILE = "result.json"
ANSWER_FILE = "answer.json"
RUN_FILES = ("metadata.json", "plan.toml", "points.csv", "samples.csv", "samples.parquet")


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """Catalogue entry of a run, result or file."""

    name: str  # relative path, for `RunsFolder.find_path`
    kind: str
    rig: str = ""  # name of the rig; of a fit or an explanation, name of the model
    started: datetime | None = None  # start of a run, or change of a result; None if unknown
    state: str = ""  # "ended", "stopped", "running"; a fit's outcome; an explanation's verdict
    simulated: bool | None = None  # whether the data are simulated; None if unknown
    summary: str = ""  # short description of the contents
    problem: str = ""  # reason why it cannot be read; else ""
    propeller: str = ""  # name of the propeller, "" if unknown
    operator: str = ""
    z_over_r: tuple[float, ...] = ()  # smallest and largest measured; empty if unknown
    radius_m: float | None = None  # rotor radius; None if unknown
    tags: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    channels: str = ""  # short hash of a run's channel names, which its samples have as columns
    values: tuple[tuple[str, float], ...] = ()  # of a fit's parameters, by its first method
    is_empty: bool = False  # whether it is a run without a measured point

    @property
    def date(self) -> str:
        """Local date and time as text, "" if unknown."""
        return f"{self.started:%Y-%m-%d %H:%M}" if self.started else ""

    @property
    def can_fit(self) -> bool:
        """Whether it is valid input of `benchtool fit`."""
        return not (self.problem or self.is_empty) and self.kind in (*SWEEPS, "table")

    def matches(self, search: str) -> bool:
        """Return whether the entry contains every search word, ignoring case."""
        texts = (self.name, self.kind, self.rig, self.date, self.state, self.summary, self.problem)
        extra = (self.propeller, self.operator, *self.tags, *self.notes)
        text = " ".join((*texts, *extra, "simulated" if self.simulated else "")).lower()
        return all(word in text for word in search.lower().split())


def detect_kind(path: Path) -> str:
    """Return the kind of a file or folder by its file names, "" if unknown.

    A run without metadata is a sweep.
    """
    if path.is_file():
        suffix = path.suffix.lower()
        if suffix in (".csv", ".parquet") and path.with_name(f"{path.name}.json").is_file():
            return "recording"
        return "table" if suffix == ".csv" else ""
    if (path / FIT_FILE).is_file():
        return "fit"
    if (path / ANSWER_FILE).is_file():
        return "explanation"
    return "sweep" if any((path / name).is_file() for name in RUN_FILES) else ""
