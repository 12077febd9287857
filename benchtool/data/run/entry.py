"""What a list shows of each thing in a runs folder, and whether its files are as stated.

What cannot be read is listed with the sentence that says why.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from datetime import datetime
from hashlib import sha256
from math import nan
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.errors import BenchtoolError, FileFormatError
from benchtool.core.plural import pluralize
from benchtool.core.recording import Recording
from benchtool.core.user_file import open_file
from benchtool.data.atomic import data_hash, file_hash, read_json
from benchtool.data.catalogue.entry import ANSWER_FILE as ANSWER_FILE
from benchtool.data.catalogue.entry import ENTRY_KINDS as ENTRY_KINDS
from benchtool.data.catalogue.entry import FIT_FILE as FIT_FILE
from benchtool.data.catalogue.entry import RUN_FILES
from benchtool.data.catalogue.entry import SWEEPS as SWEEPS
from benchtool.data.catalogue.entry import Entry as Entry
from benchtool.data.catalogue.entry import kind_of as kind_of
from benchtool.data.columns import KINDS, word_to_code
from benchtool.data.csv_text import parse_csv
from benchtool.data.run.closing import has_rows
from benchtool.data.run.labels import read_labels
from benchtool.data.run.read import is_run, parts_of, read_points
from benchtool.data.run.recording_file import FORMAT as RECORDING_FORMAT
from benchtool.data.run.recording_file import metadata_path
from benchtool.data.run.run import RUN_FORMAT
from benchtool.data.run.run_metadata import read_metadata, read_recording_facts
from benchtool.data.run.runs_folder import RunsFolder

FIT_FORMAT = "benchtool-fit-1"

HEAD_BYTES = 65_536  # As much of a table is read for the names of its columns; a choice


def build_entry(folder: RunsFolder, name: str) -> Entry:
    """Return what a list shows of one thing; a fault of its files is its `problem`, not raised.

    Raises:
        InputError: a name that leads out of the folder, or that is not there.
    """
    path = folder.path_of(name)
    known = kind_of(path)
    entry = Entry(name=name, kind=known or "unknown", started=_written(path))
    try:
        labels = read_labels(path)
        entry = replace(entry, tags=labels.tags, notes=labels.notes)
        entry = _READERS[known](entry, path) if known else replace(entry, problem=_strange(path))
    except BenchtoolError as error:
        entry = replace(entry, problem=str(error))
    except KeyError as error:
        problem = f"there is no {error} in its JSON; restore the file from a copy"
        entry = replace(entry, problem=problem)
    except (OSError, ValueError, TypeError) as error:
        entry = replace(entry, problem=f"it cannot be read ({error}); restore it from a copy")
    return replace(entry, problem=entry.problem.replace(f"{folder.root}/", ""))


def verify_run(path: Path) -> list[str]:
    """Return what of a run or fit is not as its own files say, empty where all is.

    Hashes are those of metadata.json. The Parquet of the samples alone is enough.
    """
    entry = build_entry(RunsFolder(path.resolve().parent), path.resolve().name)
    if entry.problem:
        return [entry.problem]
    if not is_run(path):
        return []
    facts = read_metadata(path)
    problems = _differing(path, facts)
    if merged := facts.get("merged_from"):
        problems += [
            f"{Path(part).name}: {problem}"
            for part, one in zip(parts_of(path), merged, strict=True)
            for problem in verify_run(Path(part))
            or (["its data have changed"] if data_hash(part) != one["sha256"] else ())
        ]
    elif entry.state == "running":
        return ["it is being measured, or its program died; then: benchtool runs close"]
    return problems


def _differing(path: Path, facts: Mapping[str, Any]) -> list[str]:
    """Return which points and samples of a run are not those of its hashes."""
    points, samples = facts.get("points") or {}, facts.get("samples") or {}
    hashes = {
        "points.csv": points.get("csv_sha256"),
        "samples.csv": samples.get("csv_sha256"),
        "samples.parquet": samples.get("parquet_sha256"),
    }
    found = []
    for name, stated in hashes.items():
        file = path / name
        if stated and not file.is_file():
            found.append(f"{name} is missing")
        elif stated and file_hash(file, follow=False) != stated:
            found.append(f"{name} has changed since the run was closed")
        elif not stated and name == "samples.csv" and has_rows(file):
            found.append(f"metadata.json states no hash of {name}: benchtool runs close")
    # The Parquet contains every sample, so the CSV may be left out.
    return [] if found == ["samples.csv is missing"] and hashes["samples.parquet"] else found


def read_result(folder: Path) -> dict[str, Any]:
    """Return the contents of a fit folder's result.json."""
    path = folder / FIT_FILE
    tables = read_json(path)
    if tables.get("format") != FIT_FORMAT:
        raise FileFormatError(
            str(path), f"its format is {tables.get('format')!r}, this version reads {FIT_FORMAT!r}"
        )
    return tables


def _strange(path: Path) -> str:
    inside = ", ".join(sorted(item.name for item in path.iterdir())[:6]) if path.is_dir() else ""
    return f"nothing that benchtool knows is in it (it holds: {inside or 'nothing'})"


def _written(path: Path) -> datetime | None:
    names = (FIT_FILE, ANSWER_FILE, *RUN_FILES)
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
    channels = _table(_table(facts, "device"), "channels")
    pitch, live = "theta_rad" in channels, facts.get("experiment") == "live"
    entry = replace(
        entry,
        kind="pitch recording" if pitch else "live recording" if live else "sweep",
        rig=str(_table(facts, "rig").get("name", "")),
        propeller=str(_table(_table(facts, "rig"), "propeller").get("name", "")),
        radius_m=_table(_table(facts, "rig"), "propulsion").get("radius_m"),
        operator=str(facts.get("operator", "")),
        channels=sha256(",".join(channels).encode()).hexdigest()[:8] if channels else "",
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
        stored = pluralize(int(count), "sample") if count is not None else ""
        return replace(entry, summary="; ".join(filter(None, (stored, reason))))
    table, running = path / "points.csv", entry.state == "running"
    begun = has_rows(path / "samples.csv") or (path / "samples.parquet").is_file()
    if not has_rows(table) and (table.is_file() or running or not begun):
        return replace(entry, summary="no point yet" if running else "no point", is_empty=True)
    try:
        points = read_points(path, KINDS)
    except BenchtoolError as error:
        return replace(entry, problem=str(error))
    if "kind" in points:
        points = points.select(np.isin(points.column("kind"), range(3)))
    summary = "; ".join(filter(None, (pluralize(len(points), "point"), reason)))
    z_over_r = _distances(points, entry.radius_m or nan)
    return replace(entry, summary=summary, z_over_r=z_over_r, is_empty=not len(points))


def _distances(points: Recording, radius_m: float) -> tuple[float, ...]:
    if "kind" not in points or "plate_z_m" not in points:
        return ()
    near = points.column("kind") == word_to_code("kind", "measure")
    ratio = points.column("plate_z_m")[near] / radius_m
    ratio = ratio[np.isfinite(ratio)]
    return (float(ratio.min()), float(ratio.max())) if len(ratio) else ()


def _fit(entry: Entry, path: Path) -> Entry:
    facts = read_result(path)
    results = _table(facts, "results")
    outcomes = [str(_table(_table(results, method), "outcome")["status"]) for method in results]
    worst = next((status for status in outcomes if status != "converged"), "converged")
    rejected = facts.get("answer") == "model rejected"
    state = "model rejected" if rejected else worst.replace("_", " ")
    recipe = _table(facts, "recipe")
    first = _table(results, next(iter(results), ""))
    verdict = str(_table(first, "facts").get("verdict", ""))
    return replace(
        entry,
        rig=str(facts["model"]),
        state=state,
        simulated=bool(facts["simulated"]),
        summary="; ".join(
            filter(
                None,
                (
                    ", ".join(map(str, recipe["data"])),
                    pluralize(_table(facts, "points")["used"], "point"),
                    verdict,
                ),
            )
        ),
        values=tuple(
            (name, float(one["value"]))
            for part in ("estimates", "derived")
            for name, one in _table(first, part).items()
        ),
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
    facts = read_recording_facts(metadata_path(path), RECORDING_FORMAT)
    rig = str(_table(facts, "provenance").get("rig", ""))
    rows = pluralize(facts["rows"], "row")
    return replace(entry, rig=rig, simulated=bool(facts["simulated"]), summary=rows)


def _csv(entry: Entry, path: Path) -> Entry:
    with open_file(path) as file:
        beginning = file.read(HEAD_BYTES)
    if b"\n" in beginning:
        beginning = beginning[: beginning.rindex(b"\n") + 1]
    header = parse_csv(beginning, entry.name, whole=False).header
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
