"""Catalogue entries read from a runs folder, and verification of their hashes.

Unreadable runs are listed too, with the reason.
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
from benchtool.core.recording import Recording
from benchtool.core.text import pluralize
from benchtool.core.user_file import open_file
from benchtool.data.atomic import data_hash, file_hash, read_json
from benchtool.data.catalogue.entry import ANSWER_FILE as ANSWER_FILE
from benchtool.data.catalogue.entry import ENTRY_KINDS as ENTRY_KINDS
from benchtool.data.catalogue.entry import FIT_FILE as FIT_FILE
from benchtool.data.catalogue.entry import RUN_FILES
from benchtool.data.catalogue.entry import SWEEPS as SWEEPS
from benchtool.data.catalogue.entry import Entry as Entry
from benchtool.data.catalogue.entry import detect_kind as detect_kind
from benchtool.data.columns import KINDS, word_to_code
from benchtool.data.csv_text import parse_csv
from benchtool.data.run.closing import has_rows
from benchtool.data.run.labels import read_labels
from benchtool.data.run.read import find_parts, is_run, read_points
from benchtool.data.run.recording_file import FORMAT as RECORDING_FORMAT
from benchtool.data.run.recording_file import metadata_path
from benchtool.data.run.run import RUN_FORMAT
from benchtool.data.run.run_metadata import read_metadata, read_recording_facts
from benchtool.data.run.runs_folder import RunsFolder

FIT_FORMAT = "benchtool-fit-1"

HEADER_BYTES = 65_536  # read of a CSV file for its column names; assumed


def build_entry(folder: RunsFolder, name: str) -> Entry:
    """Return the entry of a run, result or file; errors in its files become its `problem`.

    Raises:
        InputError: the name is outside the folder or does not exist.
    """
    path = folder.find_path(name)
    kind = detect_kind(path)
    entry = Entry(name=name, kind=kind or "unknown", started=_modification_time(path))
    try:
        labels = read_labels(path)
        entry = replace(entry, tags=labels.tags, notes=labels.notes)
        entry = (
            _READERS[kind](entry, path) if kind else replace(entry, problem=_unknown_problem(path))
        )
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
    if tables.get("format") != FIT_FORMAT:
        raise FileFormatError(
            str(path), f"format {tables.get('format')!r} is not supported; allowed: {FIT_FORMAT!r}"
        )
    return tables


def _unknown_problem(path: Path) -> str:
    contents = ", ".join(sorted(item.name for item in path.iterdir())[:6]) if path.is_dir() else ""
    return f"it contains no run, fit or table (contents: {contents or 'none'})"


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
    if facts.get("format") != RUN_FORMAT:
        raise FileFormatError(
            f"{entry.name}/metadata.json",
            f"format {facts.get('format')!r} is not supported; allowed: {RUN_FORMAT!r}",
        )
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
    facts = read_recording_facts(metadata_path(path), RECORDING_FORMAT)
    rig = str(_table(facts, "provenance").get("rig", ""))
    rows = pluralize(facts["rows"], "row")
    return replace(entry, rig=rig, simulated=bool(facts["simulated"]), summary=rows)


def _csv(entry: Entry, path: Path) -> Entry:
    with open_file(path) as file:
        head = file.read(HEADER_BYTES)
    if b"\n" in head:
        head = head[: head.rindex(b"\n") + 1]
    header = parse_csv(head, entry.name, whole=False).header
    return replace(entry, summary=", ".join(header[:8]) + (", ..." if len(header) > 8 else ""))


_READERS: dict[str, Callable[[Entry, Path], Entry]] = {
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
