"""Catalogue entries and labels (tags and notes) read from a runs folder, and verified hashes.

Unreadable runs are listed too, with the reason. Labels are not in metadata.json because the program
that measures a run rewrites that file from memory and would discard them.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from datetime import datetime
from hashlib import sha256
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.errors import BenchtoolError, FileFormatError, InputError, check_name
from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.core.toml_text import build_dataclass
from benchtool.data.atomic import data_hash, file_hash, read_json, replace_json
from benchtool.data.catalogue.entry import ANSWER_FILE as ANSWER_FILE
from benchtool.data.catalogue.entry import ENTRY_KINDS as ENTRY_KINDS
from benchtool.data.catalogue.entry import FIT_FILE as FIT_FILE
from benchtool.data.catalogue.entry import RUN_FILES
from benchtool.data.catalogue.entry import SWEEPS as SWEEPS
from benchtool.data.catalogue.entry import Entry as Entry
from benchtool.data.catalogue.entry import detect_kind as detect_kind
from benchtool.data.columns import KINDS, word_to_code
from benchtool.data.csv_text import read_csv_header
from benchtool.data.run.read import find_parts, is_run, read_points
from benchtool.data.run.recording_file import read_recording_facts
from benchtool.data.run.run import RUN_FORMAT, has_rows
from benchtool.data.run.run_metadata import check_format, read_metadata
from benchtool.data.run.runs_folder import RunsFolder

FIT_FORMAT = "benchtool-fit-1"


def build_entry(folder: RunsFolder, name: str) -> Entry:
    """Return the entry of a run, result or file; errors in its files become its `problem`."""
    path = folder.find_path(name)
    kind = detect_kind(path)
    entry = Entry(name=name, kind=kind or "unknown", started=_modification_time(path))
    try:
        labels = read_labels(path)
        entry = replace(entry, tags=labels.tags, notes=labels.notes)
        entry = _READERS[kind](entry, path)
    except BenchtoolError as error:
        entry = replace(entry, problem=str(error))
    except KeyError as error:
        entry = replace(entry, problem=f"key {error} is missing in its JSON; restore a backup")
    except (OSError, ValueError, TypeError) as error:
        entry = replace(entry, problem=f"it cannot be read ({error}); restore it from a backup")
    return replace(entry, problem=entry.problem.replace(f"{folder.root}/", ""))


def verify_run(path: Path) -> list[str]:
    """Return the differences of a run or fit from the hashes in metadata.json; empty if none.

    samples.csv may be missing if samples.parquet is there.
    """
    entry = build_entry(RunsFolder(path.resolve().parent), path.resolve().name)
    if entry.problem:
        return [entry.problem]
    if not is_run(path):
        return []
    metadata = read_metadata(path)
    problems = _verify_hashes(path, metadata)
    if sources := metadata.get("merged_from"):
        problems += [
            f"{Path(part).name}: {problem}"
            for part, source in zip(find_parts(path), sources, strict=True)
            for problem in verify_run(Path(part))
            or (["its data have changed"] if data_hash(part) != source["sha256"] else ())
        ]
    elif entry.state == "running":
        return ["it is being measured, or its program was killed; then: benchtool runs close"]
    return problems


def _verify_hashes(path: Path, metadata: Mapping[str, Any]) -> list[str]:
    """Return the differences of points and samples of a run from its hashes."""
    points, samples = metadata.get("points") or {}, metadata.get("samples") or {}
    hashes = {
        "points.csv": points.get("csv_sha256"),
        "samples.csv": samples.get("csv_sha256"),
        "samples.parquet": samples.get("parquet_sha256"),
    }
    problems = []
    for name, expected in hashes.items():
        file = path / name
        if expected and not file.is_file():
            problems.append(f"{name} is missing")
        elif expected and file_hash(file, follow=False) != expected:
            problems.append(f"{name} has changed since the run was closed")
        elif not expected and name == "samples.csv" and has_rows(file):
            problems.append(f"metadata.json has no hash of {name}: benchtool runs close")
    # samples.parquet contains every sample, so samples.csv is optional.
    return [] if problems == ["samples.csv is missing"] and hashes["samples.parquet"] else problems


def read_result(folder: Path) -> dict[str, Any]:
    """Return the contents of a fit folder's result.json."""
    path = folder / FIT_FILE
    tables = read_json(path)
    check_format(tables, FIT_FORMAT, str(path))
    return tables


def name_fits(folders: Sequence[Path]) -> dict[str, Path]:
    """Return the folders of fits to pool by their shortest unique names."""
    if len(folders) < 2:
        raise InputError(
            f"{pluralize(len(folders), 'fit')} given; minimum for pooling: 2; give folders of "
            f"benchtool fit RUN --model MODEL --out FITS/RUN"
        )
    for index, folder in enumerate(folders):
        if not (folder / FIT_FILE).is_file():
            raise InputError(f"{folder} contains no fit; give folders of benchtool fit --out")
        if folder.resolve() in (earlier.resolve() for earlier in folders[:index]):
            raise InputError(f"duplicate fit {folder}; give each folder once")
    short = [folder.resolve().name for folder in folders]
    return {
        name if short.count(name) == 1 else str(folder): folder
        for name, folder in zip(short, folders, strict=True)
    }


def _unknown(entry: Entry, path: Path) -> Entry:
    contents = ", ".join(sorted(item.name for item in path.iterdir())[:6]) if path.is_dir() else ""
    problem = f"it contains no run, fit or table (contents: {contents or 'none'})"
    return replace(entry, problem=problem)


def _modification_time(path: Path) -> datetime | None:
    names = (FIT_FILE, ANSWER_FILE, *RUN_FILES)
    files = [path] if path.is_file() else [path / name for name in names]
    times = [file.stat().st_mtime for file in files if file.is_file()]
    return datetime.fromtimestamp(times[0]).astimezone() if times else None


def _run(entry: Entry, path: Path) -> Entry:
    if not is_run(path):
        raise FileFormatError(
            entry.name, "there is no metadata.json in it, which names the rig; restore that file"
        )
    facts = read_metadata(path)
    check_format(facts, RUN_FORMAT, f"{entry.name}/metadata.json")
    channels = _table(_table(facts, "device"), "channels")
    is_pitch, is_live = "theta_rad" in channels, facts.get("experiment") == "live"
    entry = replace(
        entry,
        kind="pitch recording" if is_pitch else "live recording" if is_live else "sweep",
        rig=str(_table(facts, "rig").get("name", "")),
        propeller=str(_table(_table(facts, "rig"), "propeller").get("name", "")),
        radius_m=_table(_table(facts, "rig"), "propulsion").get("radius_m"),
        operator=str(facts.get("operator", "")),
        channels=sha256(",".join(channels).encode()).hexdigest()[:8] if channels else "",
        started=_parse_time(facts.get("started")) or entry.started,
        state=str(facts.get("state", "")),
        simulated=bool(facts["simulated"]) if "simulated" in facts else None,
    )
    reason = str(facts.get("reason") or "")
    if is_pitch:
        if not any((path / name).is_file() for name in ("samples.csv", "samples.parquet")):
            return replace(entry, problem=f"{entry.name}: it has no samples; record it again")
        count = _table(facts, "link").get("samples")
        samples = pluralize(int(count), "sample") if count is not None else ""
        return replace(entry, summary="; ".join(filter(None, (samples, reason))))
    table, is_running = path / "points.csv", entry.state == "running"
    has_samples = has_rows(path / "samples.csv") or (path / "samples.parquet").is_file()
    if not has_rows(table) and (table.is_file() or is_running or not has_samples):
        return replace(entry, summary="no point yet" if is_running else "no point", is_empty=True)
    try:
        points = read_points(path, KINDS)
    except BenchtoolError as error:
        return replace(entry, problem=str(error))
    if "kind" in points:
        points = points.select(np.isin(points.column("kind"), range(3)))
    summary = "; ".join(filter(None, (pluralize(len(points), "point"), reason)))
    z_over_r = _distance_range(points, entry.radius_m or nan)
    return replace(entry, summary=summary, z_over_r=z_over_r, is_empty=not len(points))


def _distance_range(points: Recording, radius_m: float) -> tuple[float, ...]:
    """Return the smallest and largest z/R of measured points; () if unknown."""
    if "kind" not in points or "plate_z_m" not in points:
        return ()
    is_measured = points.column("kind") == word_to_code("kind", "measure")
    z_over_r = points.column("plate_z_m")[is_measured] / radius_m
    z_over_r = z_over_r[np.isfinite(z_over_r)]
    return (float(z_over_r.min()), float(z_over_r.max())) if len(z_over_r) else ()


def _fit(entry: Entry, path: Path) -> Entry:
    facts = read_result(path)
    results = _table(facts, "results")
    statuses = [str(_table(_table(results, method), "outcome")["status"]) for method in results]
    status = next((status for status in statuses if status != "converged"), "converged")
    is_rejected = facts.get("answer") == "model rejected"
    state = "model rejected" if is_rejected else status.replace("_", " ")
    recipe = _table(facts, "recipe")
    first_result = _table(results, next(iter(results), ""))
    verdict = str(_table(first_result, "facts").get("verdict", ""))
    rig, simulated = str(facts["model"]), bool(facts["simulated"])
    data = ", ".join(map(str, recipe["data"]))
    points = pluralize(_table(facts, "points")["used"], "point")
    summary = "; ".join(filter(None, (data, points, verdict)))
    values = tuple(
        (name, float(estimate["value"]))
        for part in ("estimates", "derived")
        for name, estimate in _table(first_result, part).items()
    )
    return replace(entry, rig=rig, state=state, simulated=simulated, summary=summary, values=values)


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
    facts = read_recording_facts(path)
    rig = str(_table(facts, "provenance").get("rig", ""))
    rows = pluralize(facts["rows"], "row")
    return replace(entry, rig=rig, simulated=bool(facts["simulated"]), summary=rows)


def _csv(entry: Entry, path: Path) -> Entry:
    header = read_csv_header(path)
    return replace(entry, summary=", ".join(header[:8]) + (", ..." if len(header) > 8 else ""))


_READERS: dict[str, Callable[[Entry, Path], Entry]] = {
    "": _unknown,
    "sweep": _run,
    "fit": _fit,
    "explanation": _explanation,
    "recording": _recording,
    "table": _csv,
}


def _table(facts: dict[str, Any], key: str) -> dict[str, Any]:
    table = facts.get(key)
    return table if isinstance(table, dict) else {}


def _parse_time(text: object) -> datetime | None:
    try:
        return datetime.fromisoformat(str(text)).astimezone()
    except ValueError:
        return None


LABELS_FILE = "labels.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Labels:
    """Tags and notes of a run."""

    tags: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def read_labels(folder: Path) -> Labels:
    """Return the labels of a folder; empty if it has none."""
    path = folder / LABELS_FILE
    if not os.path.lexists(path):
        return Labels()
    return build_dataclass(Labels, read_json(path, follow=False), str(path))


def check_labels(
    folders: Iterable[Path], add: Iterable[str] = (), remove: Iterable[str] = ()
) -> None:
    """Check the arguments of `update_labels` for several folders before the first is changed."""
    remove = tuple(remove)
    for tag in add:
        check_name("tag", tag, max_length=60)
    for folder in folders:
        if not folder.is_dir():
            raise FileFormatError(
                str(folder), "there is no such folder; name runs or fits, and tags with --add"
            )
        _remaining_tags(folder, read_labels(folder), remove)


def _remaining_tags(folder: Path, labels: Labels, remove: tuple[str, ...]) -> Iterator[str]:
    if missing := [tag for tag in remove if tag not in labels.tags]:
        tags = ", ".join(labels.tags) or "none"
        raise InputError(f"{folder} has no tag {missing[0]!r} to remove (it has: {tags})")
    return (tag for tag in labels.tags if tag not in remove)


def update_labels(
    folder: Path, add: Iterable[str] = (), remove: Iterable[str] = (), note: str = ""
) -> Labels:
    """Add and remove tags, add a note, and return the new labels.

    A lock serialises programs that label the same folder (not on Windows).
    """
    add, remove = tuple(add), tuple(remove)
    check_labels((folder,), add)
    with _locked(folder):
        labels = read_labels(folder)
        tags = tuple(dict.fromkeys((*_remaining_tags(folder, labels, remove), *add)))
        new_labels = Labels(tags=tags, notes=(*labels.notes, *([note] if note else ())))
        if new_labels != labels:
            replace_json(folder / LABELS_FILE, asdict(new_labels))
    return new_labels


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    if sys.platform == "win32":
        yield
        return
    import fcntl

    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)
