"""Catalogue entries (metadata of a run, result or file) and their filters."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from math import inf
from pathlib import Path
from typing import Annotated, Literal, get_args

from annotated_types import Ge

from benchtool.core.errors import InputError
from benchtool.core.inputs import Input, Inputs

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


@dataclass(frozen=True, slots=True, kw_only=True)
class ChoiceInputs(Inputs):
    """Filter of catalogue entries; the default selects all."""

    folder: Annotated[tuple[Path, ...], Input("Folder of runs; repeatable.")] = (Path("runs"),)
    words: Annotated[str, Input("Words in name, rig, date, tags, notes.", group="Filter")] = ""
    kind: Annotated[EntryKind | None, Input("Kind of entry.", default_text="any")] = None
    rig: Annotated[str, Input("Rig of a run, model of a fit.")] = ""
    propeller: Annotated[str, Input("Propeller of the rig.")] = ""
    operator: Annotated[str, Input("Operator.")] = ""
    since: Annotated[str, Input("First day, e.g. 2026-03-01.")] = ""
    until: Annotated[str, Input("Last day, e.g. 2026-03-31.")] = ""
    z_over_r: Annotated[
        tuple[Annotated[float, Ge(0.0)], Annotated[float, Ge(0.0)]] | None,
        Input("Range of z/R, e.g. 0.5,1."),
    ] = None
    tag: Annotated[tuple[str, ...], Input("Required tags.", comma_separated=True)] = ()
    state: Annotated[
        str, Input("State of a run, outcome of a fit or verdict of an explanation.")
    ] = ""
    fitted: Annotated[
        tuple[str, ...], Input("Fitted parameter, optionally with range: body_lift.K_b=1.8..2.1.")
    ] = ()


def filter_entries(entries: Iterable[Entry], by: ChoiceInputs) -> tuple[Entry, ...]:
    """Return the entries that match all conditions, in their order."""
    since, until = _day(by.since, "since"), _day(by.until, "until")
    low, high = by.z_over_r or (0.0, inf)
    if low > high:
        raise InputError(f"z-over-r is {low:g} to {high:g}; give the smaller limit first")
    conditions = [_parse_condition(text) for text in by.fitted]
    exact = {
        name: value.lower()
        for name in ("kind", "rig", "propeller", "operator", "state")
        if (value := getattr(by, name))
    }
    return tuple(
        entry
        for entry in entries
        if all(getattr(entry, name).lower() == value for name, value in exact.items())
        and (not since or (entry.date[:10] >= since))
        and (not until or ("" < entry.date[:10] <= until))
        and (
            by.z_over_r is None
            or (entry.z_over_r and entry.z_over_r[0] <= high and entry.z_over_r[1] >= low)
        )
        and set(by.tag) <= set(entry.tags)
        and all(_has_value(entry, *condition) for condition in conditions)
        and (not by.words or entry.matches(by.words))
    )


def _parse_condition(text: str) -> tuple[str, float, float]:
    """Return name and limits of a fitted parameter, from NAME or NAME=LOW..HIGH."""
    name, has_limits, limits = text.partition("=")
    low_text, _, high_text = limits.partition("..")
    try:
        low, high = (float(low_text), float(high_text)) if has_limits else (-inf, inf)
    except ValueError:
        low, high = 1.0, 0.0
    if not name or not low <= high:
        raise InputError(
            f"fitted is {text!r}; give a parameter, optionally with limits, the smaller first: "
            f"body_lift.K_b=1.8..2.1"
        )
    return name, low, high


def _has_value(entry: Entry, name: str, low: float, high: float) -> bool:
    return any(
        (parameter == name or parameter.endswith(f".{name}")) and low <= value <= high
        for parameter, value in entry.values
    )


def _day(text: str, option: str) -> str:
    if not text:
        return ""
    try:
        return f"{datetime.strptime(text, '%Y-%m-%d').date()}"  # noqa: DTZ007
    except ValueError:
        raise InputError(f"{option} is {text!r}; give a date like 2026-03-31") from None
