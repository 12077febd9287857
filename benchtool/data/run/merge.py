"""Merge runs of one rig into a new run folder, the runs themselves as its parts.

What belongs to each run alone (calibration, air, samples, events) stays with it in `parts`, and a
fit takes the parts. The points of all stand in one points.csv for tables, figures and queries.
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
from benchtool.data.run.points import write_table
from benchtool.data.run.read import PARTS, is_pitch_run, is_run, parts_of, read_points
from benchtool.data.run.run import Run, check_not_existing
from benchtool.data.run.run_metadata import read_metadata
from benchtool.data.run.run_rig import load_rig_for_data
from benchtool.data.run.settings import load_settings

_AIR = ("temperature_degC", "pressure_Pa", "humidity")


def merge_runs(paths: Sequence[Path], out: Path) -> Run:
    """Write a new run folder with the points of several runs, and copies of them in `parts`.

    Args:
        paths: of runs of one rig and propeller; of a merged one its parts are taken.

    Raises:
        InputError: fewer than two, other rigs or propellers, the same data twice, or one that is
            being measured.
        FileFormatError: one that is no run of points.
        WouldOverwrite: `out` exists.
    """
    check_not_existing(out)
    sources = [Path(part) for path in paths for part in parts_of(path)]
    if len(sources) < 2:
        raise InputError(f"one run is named, {paths[0]}; name two or more to merge")
    facts = [_facts(path) for path in sources]
    _refuse_other_rigs(sources, facts)
    hashes = _hashes(sources)
    names = [f"{number:03d}-{path.resolve().name}" for number, path in enumerate(sources, 1)]
    origin = [
        {"run": name, "from": str(path), "sha256": sha256, "started": str(one.get("started", ""))}
        for name, path, sha256, one in zip(names, sources, hashes, facts, strict=True)
    ]
    points = joined_points([read_points(path, VALID_KINDS) for path in sources])
    beside = out.with_name(f".{out.name}.{os.getpid()}.merge")
    try:
        run = Run.create(beside, _plan(sources), {**_common(facts), "merged_from": origin})
        for path, name in zip(sources, names, strict=True):
            shutil.copytree(
                path, beside / PARTS / name, ignore=shutil.ignore_patterns(".*", "recalibrated-*")
            )
        if [data_hash(beside / PARTS / name) for name in names] != hashes:
            raise InputError("a run changed while it was copied; merge again when none is written")
        run.write_points(points)
        write_table(run.path / "settings.csv", load_settings(run.path))
        check_not_existing(out)
        if out.is_dir():
            shutil.rmtree(out)
        os.rename(beside, out)
    finally:
        shutil.rmtree(beside, ignore_errors=True)
    sync_folder(out.parent)
    return Run(out)


def joined_points(parts: Sequence[Recording]) -> Recording:
    """Return the points of runs one after the other, `part` saying of which run each is, from 1.

    Visits, settings and repeats are numbered on from part to part, and time goes on.
    """
    names = [name for name in parts[0].names if all(name in part for part in parts)]
    columns = {name: [part.column(name) for part in parts] for name in names}
    for name in {"point", "setting", "repeat", "time_s"} & columns.keys():
        last = 0.0
        for place, values in enumerate(columns[name]):
            # A tare has neither visit nor setting: 0.
            columns[name][place] = np.where((values > 0.0) | (name == "time_s"), values + last, 0.0)
            last = max(last, float(np.nanmax(columns[name][place])))
    number = np.repeat(np.arange(1.0, len(parts) + 1.0), [len(part) for part in parts])
    pairs = [(Channel("part", "1"), number)]
    pairs += [
        (parts[0].channels[parts[0].index(name)], np.concatenate(columns[name])) for name in names
    ]
    return Recording.from_columns(pairs, {}, any(part.simulated for part in parts))


def _facts(path: Path) -> dict[str, Any]:
    if not is_run(path):
        raise FileFormatError(str(path), "this is no run folder; name runs of benchtool sweep")
    if is_pitch_run(path):
        raise FileFormatError(str(path), "a pitch recording has no points to merge; leave it out")
    facts = read_metadata(path)
    if facts.get("state") == "running":
        raise InputError(
            f"{path} is being measured, or its program died; merge it when it has ended, or after "
            f"benchtool runs close {path}"
        )
    return facts


def _refuse_other_rigs(paths: Sequence[Path], facts: Sequence[Mapping[str, Any]]) -> None:
    load_rig_for_data([str(path) for path in paths])
    rigs = [one.get("rig") or {} for one in facts]
    for what, named in (("rig", rigs), ("propeller", [rig.get("propeller") or {} for rig in rigs])):
        shown = [str(one.get("name", "")) for one in named]
        if other := next((place for place, one in enumerate(shown) if one != shown[0]), 0):
            raise InputError(
                f"{paths[0]} is of {what} {shown[0] or 'not stated'!r} and {paths[other]} of "
                f"{shown[other] or 'not stated'!r}; merge runs of one {what}, or compare them with "
                f"benchtool runs compare"
            )


def _hashes(paths: Sequence[Path]) -> list[str]:
    hashes = [data_hash(path) for path in paths]
    for place, one in enumerate(hashes):
        if (first := hashes.index(one)) < place:
            raise InputError(
                f"{paths[place]} holds the same data as {paths[first]}; points count once, so name "
                f"it once"
            )
    return hashes


def _plan(paths: Sequence[Path]) -> str:
    head = f"# The plan of the first of {len(paths)} merged runs; each has its own in {PARTS}/.\n"
    return head + Run.open(paths[0]).plan_text


def _common(facts: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return what metadata of several runs say in common, and the mean of their air."""
    first = facts[0]
    shared = {key: first[key] for key in first if all(one.get(key) == first[key] for one in facts)}
    for key in ("format", "samples", "points", "reason", "link"):
        shared.pop(key, None)
    airs = [one.get("air") or {} for one in facts]
    if all(airs):
        mean = [float(np.mean([air[name] for air in airs])) for name in _AIR]
        density = air_density_kg_m3(*mean)
        measured = all(air.get("measured") for air in airs)
        shared["air"] = {**airs[0], **dict(zip(_AIR, mean, strict=True)),
                         "density_kg_m3": density, "measured": measured}  # fmt: skip
    began = [str(one["started"]) for one in facts if one.get("started")]
    return {
        **shared,
        "rig": first["rig"],
        "simulated": any(one.get("simulated") for one in facts),
        "state": "ended",
        "visits": sum(int(one.get("visits") or 0) for one in facts),
        **({"started": min(began)} if began else {}),
    }
