"""What a list shows of each thing in a runs folder: kind, rig, date, how it ended.

What cannot be read is listed with the sentence that says why.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import Any

from benchtool.core.counted import counted
from benchtool.core.errors import BenchtoolError, FileFormatError
from benchtool.core.user_file import open_file
from benchtool.data.atomic import read_json
from benchtool.data.columns import KINDS
from benchtool.data.csv_text import parse_csv
from benchtool.data.run.facts import read_metadata, read_recording_facts
from benchtool.data.run.read import is_run, read_points
from benchtool.data.run.recording_file import FORMAT as RECORDING_FORMAT
from benchtool.data.run.recording_file import beside
from benchtool.data.run.run import RUN_FORMAT
from benchtool.data.run.runs_folder import RunsFolder

FIT_FORMAT = "benchtool-fit-1"
FIT_FILE = "result.json"
ANSWER_FILE = "answer.json"

ENTRY_KINDS: tuple[str, ...] = (
    "sweep",
    "pitch recording",
    "fit",
    "explanation",
    "recording",
    "table",
    "unknown",
)
"""What an entry may be. A recording is one file with its JSON beside it, a table any CSV."""

HEAD_BYTES = 65_536
"""As much of a table is read for the names of its columns; a choice."""

_RUN_FILES = ("metadata.json", "plan.toml", "points.csv", "samples.csv", "samples.parquet")


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """Hold what a list shows of one thing in the runs folder.

    Attributes:
        name: by which `RunsFolder.path_of` finds it.
        rig: name of the rig, or for a fit and an explanation of the model.
        started: when the run began, or when a result was written; None where it is not known.
        state: "ended", "stopped", "running"; a fit's outcome; an explanation's verdict.
        simulated: whether no physical bench made the data; None where it is not known.
        summary: a few words on what is in it.
        problem: one sentence on why it cannot be read; empty where it can.
    """

    name: str
    kind: str
    rig: str = ""
    started: datetime | None = None
    state: str = ""
    simulated: bool | None = None
    summary: str = ""
    problem: str = ""

    @property
    def date(self) -> str:
        """Day and time for people, empty where it is not known."""
        return f"{self.started:%Y-%m-%d %H:%M}" if self.started else ""

    @property
    def can_fit(self) -> bool:
        """Whether `benchtool fit` takes it."""
        return not self.problem and self.kind in ("sweep", "table")

    def matches(self, words: str) -> bool:
        """Return whether each of some words stands anywhere in the entry, in any case."""
        shown = (self.name, self.kind, self.rig, self.date, self.state, self.summary, self.problem)
        text = " ".join((*shown, "simulated" if self.simulated else "")).lower()
        return all(word in text for word in words.lower().split())


def entry_of(folder: RunsFolder, name: str) -> Entry:
    """Return what a list shows of one thing; a fault of its files is its `problem`, not raised.

    Raises:
        InputError: a name that leads out of the folder, or that is not there.
    """
    path = folder.path_of(name)
    known = kind_of(path)
    entry = Entry(name=name, kind=known or "unknown", started=_written(path))
    try:
        entry = _READERS[known](entry, path) if known else replace(entry, problem=_strange(path))
    except BenchtoolError as error:
        entry = replace(entry, problem=str(error))
    except KeyError as error:
        problem = f"there is no {error} in its JSON; restore the file from a copy"
        entry = replace(entry, problem=problem)
    except (OSError, ValueError, TypeError) as error:
        entry = replace(entry, problem=f"it cannot be read ({error}); restore it from a copy")
    return replace(entry, problem=entry.problem.replace(f"{folder.root}/", ""))


def read_result(folder: Path) -> dict[str, Any]:
    """Return the contents of a fit folder's result.json."""
    path = folder / FIT_FILE
    tables = read_json(path)
    if tables.get("format") != FIT_FORMAT:
        raise FileFormatError(
            str(path), f"its format is {tables.get('format')!r}, this version reads {FIT_FORMAT!r}"
        )
    return tables


def kind_of(path: Path) -> str:
    """Return the kind of what is at a path by the names of its files, empty for none.

    A run without its metadata counts as a sweep.
    """
    if path.is_file():
        if path.suffix.lower() in (".csv", ".parquet") and beside(path).is_file():
            return "recording"
        return "table" if path.suffix.lower() == ".csv" else ""
    if (path / FIT_FILE).is_file():
        return "fit"
    if (path / ANSWER_FILE).is_file():
        return "explanation"
    return "sweep" if any((path / name).is_file() for name in _RUN_FILES) else ""


def _strange(path: Path) -> str:
    inside = ", ".join(sorted(item.name for item in path.iterdir())[:6]) if path.is_dir() else ""
    return f"nothing that benchtool knows is in it (it holds: {inside or 'nothing'})"


def _written(path: Path) -> datetime | None:
    names = (FIT_FILE, ANSWER_FILE, *_RUN_FILES)
    files = [path] if path.is_file() else [path / name for name in names]
    times = [file.stat().st_mtime for file in files if file.is_file()]
    return datetime.fromtimestamp(times[0]).astimezone() if times else None


def _run(entry: Entry, path: Path) -> Entry:
    if not is_run(path):
        raise FileFormatError(
            entry.name, "there is no metadata.json in it, so nothing names its rig; restore it"
        )
    facts = read_metadata(path)
    if facts.get("format") != RUN_FORMAT:
        raise FileFormatError(
            f"{entry.name}/metadata.json",
            f"its format is {facts.get('format')!r}, this version reads {RUN_FORMAT!r}",
        )
    pitch = "theta_rad" in _table(_table(facts, "device"), "channels")
    entry = replace(
        entry,
        kind="pitch recording" if pitch else "sweep",
        rig=str(_table(facts, "rig").get("name", "")),
        started=_moment(facts.get("started")) or entry.started,
        state=str(facts.get("state", "")),
        simulated=bool(facts["simulated"]) if "simulated" in facts else None,
    )
    reason = str(facts.get("reason") or "")
    if pitch:
        if not any((path / name).is_file() for name in ("samples.csv", "samples.parquet")):
            problem = f"{entry.name}: there are no samples in it; record it again"
            return replace(entry, problem=problem)
        count = _table(facts, "link").get("samples")
        stored = counted(int(count), "sample") if count is not None else ""
        return replace(entry, summary="; ".join(filter(None, (stored, reason))))
    if not (path / "points.csv").is_file() and entry.state == "running":
        return replace(entry, summary="no point yet")
    try:
        points = counted(len(read_points(path, KINDS[:3])), "point")
    except BenchtoolError as error:
        return replace(entry, problem=str(error))
    return replace(entry, summary="; ".join(filter(None, (points, reason))))


def _fit(entry: Entry, path: Path) -> Entry:
    facts = read_result(path)
    results = _table(facts, "results")
    outcomes = [str(_table(_table(results, method), "outcome")["status"]) for method in results]
    worst = next((status for status in outcomes if status != "converged"), "converged")
    rejected = facts.get("answer") == "model rejected"
    state = "model rejected" if rejected else worst.replace("_", " ")
    recipe = _table(facts, "recipe")
    return replace(
        entry,
        rig=str(facts["model"]),
        state=state,
        simulated=bool(facts["simulated"]),
        summary=f"{', '.join(map(str, recipe['data']))}; "
        f"{counted(_table(facts, 'points')['used'], 'point')}",
    )


def _explanation(entry: Entry, path: Path) -> Entry:
    facts = read_json(path / ANSWER_FILE)
    return replace(
        entry,
        rig=str(facts["model"]),
        state=str(facts["verdict"]),
        simulated=bool(facts["simulated"]),
        summary=str(facts["sentence"]),
    )


def _recording(entry: Entry, path: Path) -> Entry:
    facts = read_recording_facts(beside(path), RECORDING_FORMAT)
    rig = str(_table(facts, "provenance").get("rig", ""))
    rows = counted(facts["rows"], "row")
    return replace(entry, rig=rig, simulated=bool(facts["simulated"]), summary=rows)


def _csv(entry: Entry, path: Path) -> Entry:
    with open_file(path) as file:
        beginning = file.read(HEAD_BYTES)
    if b"\n" in beginning:
        beginning = beginning[: beginning.rindex(b"\n") + 1]
    header = parse_csv(beginning, entry.name).header
    return replace(entry, summary=", ".join(header[:8]) + (", ..." if len(header) > 8 else ""))


_READERS: dict[str, Callable[[Entry, Path], Entry]] = {
    "sweep": _run,
    "fit": _fit,
    "explanation": _explanation,
    "recording": _recording,
    "table": _csv,
}


def _table(facts: dict[str, Any], key: str) -> dict[str, Any]:
    found = facts.get(key)
    return found if isinstance(found, dict) else {}


def _moment(text: object) -> datetime | None:
    try:
        return datetime.fromisoformat(str(text)).astimezone()
    except ValueError:
        return None


DEEPEST = 3
"""Folders of folders that are looked through for entries; a choice."""


Seen = dict[str, tuple[int, Entry]]
"""Entries by name as they were read last, with the newest time of their files."""


def list_entries(folder: RunsFolder, seen: Seen | None = None) -> tuple[Entry, ...]:
    """Return everything in a runs folder, the newest first; a folder that is not there is empty.

    Args:
        seen: passed again to the next call, so that only what has changed is read again.
    """
    if not folder.root.is_dir():
        return ()
    found = list(_in_folder(folder, folder.root, DEEPEST, {} if seen is None else seen))
    dated = [entry for entry in found if entry.started is not None]
    dated.sort(key=lambda entry: entry.started.timestamp() if entry.started else 0.0, reverse=True)
    undated = sorted((entry for entry in found if entry.started is None), key=lambda e: e.name)
    return (*dated, *undated)


def search(entries: Iterable[Entry], words: str = "", kind: str = "") -> tuple[Entry, ...]:
    """Return the entries that match some words and are of a kind; "" matches any."""
    return tuple(
        entry for entry in entries if (not kind or entry.kind == kind) and entry.matches(words)
    )


def _in_folder(folder: RunsFolder, path: Path, depth: int, seen: Seen) -> Iterator[Entry]:
    for item in sorted(path.iterdir()):
        if item.name.startswith("."):
            continue
        name = folder.name_of(item)
        try:
            folder.path_of(name)
        except BenchtoolError as error:
            if item.is_dir() or item.is_symlink():
                yield Entry(name=name, kind="unknown", problem=str(error))
            continue
        known = kind_of(item)
        if known:
            yield _entry(folder, item, seen)
            within = item.glob("recalibrated-*") if known == "sweep" else ()
            yield from (_entry(folder, inner, seen) for inner in sorted(within))
        elif item.is_dir():
            inside = list(_in_folder(folder, item, depth - 1, seen)) if depth > 1 else []
            yield from inside or [_entry(folder, item, seen)]


def _entry(folder: RunsFolder, path: Path, seen: Seen) -> Entry:
    """Return one entry, read again only where one of its files has changed."""
    name = folder.name_of(path)
    files = [path, *path.iterdir()] if path.is_dir() else [path, beside(path)]
    stamp = max(os.lstat(file).st_mtime_ns for file in files if os.path.lexists(file))
    if name not in seen or seen[name][0] != stamp:
        seen[name] = (stamp, entry_of(folder, name))
    return seen[name][1]
