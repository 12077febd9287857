"""What a list shows of each thing in a runs folder."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Literal, get_args

EntryKind = Literal[  # a recording is one file with its JSON beside it, a table any CSV
    "sweep",
    "live recording",
    "pitch recording",
    "fit",
    "explanation",
    "recording",
    "table",
    "unknown",
]

SWEEPS = ("sweep", "live recording")  # runs with points: by a plan, or of motors turned by hand

ENTRY_KINDS: tuple[str, ...] = get_args(EntryKind)


FIT_FILE = "result.json"
ANSWER_FILE = "answer.json"
RUN_FILES = ("metadata.json", "plan.toml", "points.csv", "samples.csv", "samples.parquet")


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """Hold what a list shows of one thing in the runs folder.

    Attributes:
        name: by which `RunsFolder.path_of` finds it.
        rig: name of the rig, or for a fit and an explanation of the model.
        propeller: its name where the rig states it.
        z_over_r: least and largest distance of the plate at which it was measured, in rotor radii;
            empty where that is not known.
        radius_m: of the rotors; None where the rig does not state it.
        tags, notes: of `labels`.
        channels: short hash of the names of a run's channels; runs of one have samples of one form.
        values: each parameter of a fit with its value, by its first method.
        started: when the run began, or when a result was written; None where it is not known.
        state: "ended", "stopped", "running"; a fit's outcome; an explanation's verdict.
        simulated: whether no physical bench made the data; None where it is not known.
        summary: a few words on what is in it.
        problem: one sentence on why it cannot be read; empty where it can.
        is_empty: whether it is a run without a measured point.
    """

    name: str
    kind: str
    rig: str = ""
    started: datetime | None = None
    state: str = ""
    simulated: bool | None = None
    summary: str = ""
    problem: str = ""
    propeller: str = ""
    operator: str = ""
    z_over_r: tuple[float, ...] = ()
    radius_m: float | None = None
    tags: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    channels: str = ""
    values: tuple[tuple[str, float], ...] = ()
    is_empty: bool = False

    @property
    def date(self) -> str:
        """Day and time for people, empty where it is not known."""
        return f"{self.started:%Y-%m-%d %H:%M}" if self.started else ""

    @property
    def can_fit(self) -> bool:
        """Whether `benchtool fit` takes it."""
        return not (self.problem or self.is_empty) and self.kind in (*SWEEPS, "table")

    def matches(self, words: str) -> bool:
        """Return whether each of some words stands anywhere in the entry, in any case."""
        shown = (self.name, self.kind, self.rig, self.date, self.state, self.summary, self.problem)
        own = (self.propeller, self.operator, *self.tags, *self.notes)
        text = " ".join((*shown, *own, "simulated" if self.simulated else "")).lower()
        return all(word in text for word in words.lower().split())


def kind_of(path: Path) -> str:
    """Return the kind of what is at a path by the names of its files, empty for none.

    A run without its metadata counts as a sweep.
    """
    if path.is_file():
        if (
            path.suffix.lower() in (".csv", ".parquet")
            and path.with_name(f"{path.name}.json").is_file()
        ):
            return "recording"
        return "table" if path.suffix.lower() == ".csv" else ""
    if (path / FIT_FILE).is_file():
        return "fit"
    if (path / ANSWER_FILE).is_file():
        return "explanation"
    return "sweep" if any((path / name).is_file() for name in RUN_FILES) else ""
