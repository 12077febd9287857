"""Merging of runs of one rig into a new run folder.

Copies of the runs in `parts` keep their calibration, air, samples and events, and fits use them.
A common points.csv is for tables, figures and queries.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.air import air_density_kg_m3
from benchtool.core.channel import Channel
from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.recording import Recording
from benchtool.data.atomic import data_hash, sync_folder
from benchtool.data.columns import VALID_KINDS
from benchtool.data.run.points import load_settings, write_table
from benchtool.data.run.read import (
    PARTS,
    find_parts,
    is_pitch_run,
    is_run,
    load_rig_for_data,
    read_points,
)
from benchtool.data.run.run import Run, check_not_existing
from benchtool.data.run.run_metadata import read_metadata

_AIR = ("temperature_degC", "pressure_Pa", "humidity")


def merge_runs(paths: Sequence[Path], out: Path) -> Run:
    """Write a new run folder with the points of several runs, and copies of them in `parts`.

    They have one rig and propeller; a merged run is replaced by its parts.
    """
    check_not_existing(out)
    sources = [Path(part) for path in paths for part in find_parts(path)]
    if len(sources) < 2:
        raise InputError(f"only one run, {paths[0]}; give two or more to merge")
    metadata = [_read_metadata(path) for path in sources]
    _check_same_rig(sources, metadata)
    hashes = _compute_hashes(sources)
    names = [f"{number:03d}-{path.resolve().name}" for number, path in enumerate(sources, 1)]
    origins = [
        {"run": name, "from": str(path), "sha256": sha256, "started": str(data.get("started", ""))}
        for name, path, sha256, data in zip(names, sources, hashes, metadata, strict=True)
    ]
    points = concatenate_points([read_points(path, VALID_KINDS) for path in sources])
    head = f"# The plan of the first of {len(sources)} merged runs; each has its own in {PARTS}/.\n"
    plan_text = head + Run.open(sources[0]).plan_text
    new_path = out.with_name(f".{out.name}.{os.getpid()}.merge")
    try:
        run = Run.create(new_path, plan_text, _merge_metadata(metadata, origins))
        for path, name in zip(sources, names, strict=True):
            ignore = shutil.ignore_patterns(".*", "recalibrated-*")
            shutil.copytree(path, new_path / PARTS / name, ignore=ignore)
        if [data_hash(new_path / PARTS / name) for name in names] != hashes:
            raise InputError("a run changed while it was copied; repeat when no run is written")
        run.write_points(points)
        write_table(run.path / "settings.csv", load_settings(run.path))
        check_not_existing(out)
        if out.is_dir():
            shutil.rmtree(out)
        os.rename(new_path, out)
    finally:
        shutil.rmtree(new_path, ignore_errors=True)
    sync_folder(out.parent)
    return Run(out)


def concatenate_points(parts: Sequence[Recording]) -> Recording:
    """Return the points of all runs; the column `part` is the number of the run, from 1.

    Numbers of points, settings and repeats, and time, continue from part to part.
    """
    names = [name for name in parts[0].names if all(name in part for part in parts)]
    columns = {name: [part.column(name) for part in parts] for name in names}
    for name in {"point", "setting", "repeat", "time_s"} & columns.keys():
        last = 0.0
        for index, values in enumerate(columns[name]):
            # A tare has point and setting 0.
            columns[name][index] = np.where((values > 0.0) | (name == "time_s"), values + last, 0.0)
            last = max(last, float(np.nanmax(columns[name][index])))
    part_numbers = np.repeat(np.arange(1.0, len(parts) + 1.0), [len(part) for part in parts])
    pairs = [(Channel("part", "1"), part_numbers)]
    pairs += [
        (parts[0].channels[parts[0].index(name)], np.concatenate(columns[name])) for name in names
    ]
    return Recording.from_columns(pairs, {}, any(part.simulated for part in parts))


def _read_metadata(path: Path) -> dict[str, Any]:
    if not is_run(path):
        raise FileFormatError(str(path), "this is not a run folder; give runs of benchtool sweep")
    if is_pitch_run(path):
        raise FileFormatError(str(path), "a pitch recording has no points to merge; remove it")
    metadata = read_metadata(path)
    if metadata.get("state") == "running":
        raise InputError(
            f"{path} is being measured, or its program was killed; merge it when it has ended, or "
            f"after benchtool runs close {path}"
        )
    return metadata


def _check_same_rig(paths: Sequence[Path], metadata: Sequence[Mapping[str, Any]]) -> None:
    load_rig_for_data([str(path) for path in paths])
    rigs = [data.get("rig") or {} for data in metadata]
    propellers = [rig.get("propeller") or {} for rig in rigs]
    for kind, tables in (("rig", rigs), ("propeller", propellers)):
        names = [str(table.get("name", "")) for table in tables]
        if other := next((index for index, name in enumerate(names) if name != names[0]), 0):
            raise InputError(
                f"{paths[0]} is of {kind} {names[0] or 'unnamed'!r} and {paths[other]} of "
                f"{names[other] or 'unnamed'!r}; merge runs of one {kind}, or use benchtool runs "
                f"compare"
            )


def _compute_hashes(paths: Sequence[Path]) -> list[str]:
    hashes = [data_hash(path) for path in paths]
    for index, sha256 in enumerate(hashes):
        if (first := hashes.index(sha256)) < index:
            raise InputError(
                f"duplicate data: {paths[index]} and {paths[first]} are identical; remove one"
            )
    return hashes


def _merge_metadata(
    metadata: Sequence[dict[str, Any]], origins: Sequence[Mapping[str, str]]
) -> dict[str, Any]:
    """Return the metadata that all runs share, with the mean of their air and their origins."""
    first = metadata[0]
    shared = {key: first[key] for key in first if all(m.get(key) == first[key] for m in metadata)}
    for key in ("format", "samples", "points", "reason", "link"):
        shared.pop(key, None)
    airs = [data.get("air") or {} for data in metadata]
    if all(airs):
        mean = [float(np.mean([air[name] for air in airs])) for name in _AIR]
        density = air_density_kg_m3(*mean)
        measured = all(air.get("measured") for air in airs)
        shared["air"] = {**airs[0], **dict(zip(_AIR, mean, strict=True)),
                         "density_kg_m3": density, "measured": measured}  # fmt: skip
    start_times = [str(data["started"]) for data in metadata if data.get("started")]
    return {
        **shared,
        "rig": first["rig"],
        "simulated": any(data.get("simulated") for data in metadata),
        "state": "ended",
        "visits": sum(int(data.get("visits") or 0) for data in metadata),
        **({"started": min(start_times)} if start_times else {}),
        "merged_from": origins,
    }
