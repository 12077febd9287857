"""Read runs back: points, settings and samples as recordings that say where they come from."""

from __future__ import annotations

import os
import re
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchtool.core.channel import Channel
from benchtool.core.errors import BenchtoolError, DataWarning, FileFormatError
from benchtool.core.recording import Recording
from benchtool.data.atomic import data_hash, file_hash
from benchtool.data.columns import check_numbers, find_channel, word_to_code
from benchtool.data.csv_text import read_csv_text
from benchtool.data.parquet import parquet_names, read_parquet
from benchtool.data.run.run_metadata import read_metadata
from benchtool.data.run.sample_stream import header_of, read_stream
from benchtool.data.table import table_columns


def is_run(path: str | Path) -> bool:
    """Return whether a path is a run folder."""
    return os.path.lexists(Path(path) / "metadata.json")


PARTS = "parts"  # Folder of a merged run with the runs that it was made of


def parts_of(path: str | Path) -> tuple[str, ...]:
    """Return the runs that a merged run holds, in their order; the path itself for all others.

    Raises:
        FileFormatError: one of them is missing.
    """
    stated = read_metadata(Path(path)).get("merged_from") if is_run(path) else None
    if not stated:
        return (str(path),)
    folder = Path(path) / PARTS
    found = folder.iterdir() if folder.is_dir() and not folder.is_symlink() else ()
    there = sorted(item.name for item in found if is_run(item) and not item.is_symlink())
    if there != (wanted := [str(one["run"]) for one in stated]):
        missing = sorted({*wanted} ^ {*there})
        raise FileFormatError(
            f"{path}/{PARTS}",
            f"it holds {len(there)} of the {len(wanted)} runs that metadata.json names "
            f"({missing[0]} differs); restore it from a copy, or merge again",
        )
    return tuple(str(folder / name) for name in there)


def read_points(
    path: str | Path, kinds: Iterable[str] = ("measure", "reference", "anchor")
) -> Recording:
    """Return the points of a run folder, or of any points.csv, without the tares.

    Args:
        kinds: which kinds of points to keep, of `columns.KINDS`.
    """
    recording = _read(_file(path, "points.csv"), Path(path))
    for changed in changed_points(path):
        warnings.warn(changed, DataWarning, stacklevel=1)  # shown once for all callers
    if "kind" not in recording:
        return recording
    wanted = [word_to_code("kind", kind) for kind in kinds]
    chosen = recording.select(np.isin(recording.column("kind"), wanted))
    if not len(chosen):
        raise FileFormatError(
            str(path), f"no point of kind {', '.join(kinds)} stands in it; let the sweep measure"
        )
    return chosen


def changed_points(path: str | Path) -> tuple[str, ...]:
    """Return a sentence if points.csv (or that of a run) has not the hash that its run states."""
    file = Path(path) / "points.csv" if os.path.isdir(path) else Path(path)
    if file.name != "points.csv" or not file.is_file() or not is_run(file.parent):
        return ()
    stated = (read_metadata(file.parent).get("points") or {}).get("csv_sha256")
    if not stated or stated == file_hash(file, follow=file == Path(path)):
        return ()
    return (
        f"{file} has changed since the run was closed; restore it from a copy; if the edit was on "
        f"purpose, say so with benchtool runs note, or edit a table made with benchtool runs "
        f"export --table points",
    )


def read_settings(path: str | Path) -> Recording:
    """Return the settings of a closed run folder, or of any settings.csv."""
    return _read(_file(path, "settings.csv"), Path(path))


def read_samples(path: str | Path, names: Sequence[str] | None = None) -> Recording:
    """Return every sample of a run folder, or of any samples.csv.

    The hashed Parquet of a closed run is preferred; where it does not match what the metadata
    say, the CSV is read in its place and a warning says so. Of an hour at 1 kHz each column takes
    29 MB.

    Args:
        names: of the columns to read, those that are not in the file left out; all when left out.
    """
    path = Path(path)
    parquet = path / "samples.parquet"
    if is_run(path) and parquet.is_file():
        stated = read_metadata(path).get("samples") or {}
        problem = _mismatch(parquet, path / "samples.csv", stated)
        if not problem:
            recording = read_parquet(parquet, names)
            check_numbers(recording, str(parquet))
            return _with_provenance(recording, parquet, path, ())
        text = f"{parquet}: {problem}; samples.csv was read instead"
        warnings.warn(text, DataWarning, stacklevel=1)
        recording = _read_samples(path / "samples.csv", path, names)
        repairs = "; ".join(filter(None, (recording.provenance["repairs"], problem)))
        return replace(recording, provenance={**recording.provenance, "repairs": repairs})
    return _read_samples(_file(path, "samples.csv"), path, names)


def sample_names(path: str | Path) -> tuple[str, ...]:
    """Return the columns of the samples of a run folder, or of any samples.csv."""
    parquet = Path(path) / "samples.parquet"
    if parquet.is_file() and not os.path.lexists(Path(path) / "samples.csv"):
        return parquet_names(parquet)
    return header_of(_file(path, "samples.csv"), follow=not Path(path).is_dir())


def _file(path: str | Path, name: str) -> Path:
    path = Path(path)
    if not os.path.lexists(path):
        raise FileFormatError(str(path), "there is no such run or file; check the path")
    if not os.path.isdir(path):
        return path
    if not os.path.lexists(path / name):
        inside = ", ".join(sorted(item.name for item in path.iterdir())[:8]) or "nothing"
        advice = "close it with benchtool runs close" if is_run(path) else "name a run"
        raise FileFormatError(str(path), f"there is no {name} in it (it holds: {inside}); {advice}")
    return path / name


def _read(file: Path, path: Path) -> Recording:
    table = read_csv_text(file, own=True, follow=not path.is_dir())
    recording = Recording.from_columns(table_columns(table))
    check_numbers(recording, str(file))
    return _with_provenance(recording, file, path, table.repairs)


def _read_samples(file: Path, path: Path, names: Sequence[str] | None) -> Recording:
    try:
        present, values, cut = read_stream(file, names)
        recording = Recording(tuple(find_channel(name) for name in present), values)
    except BenchtoolError:
        # Not as we write it: read like anybody's table, or refused with the line that is wrong.
        recording = _read(file, path)
        return recording if names is None else recording.drop({*recording.names} - {*names})
    check_numbers(recording, str(file))
    repairs = ("the last line was cut short and left out",) if cut else ()
    return _with_provenance(recording, file, path, repairs)


def _with_provenance(
    recording: Recording, file: Path, path: Path, repairs: tuple[str, ...]
) -> Recording:
    folder = path if path.is_dir() else path.parent
    facts: dict[str, Any] = read_metadata(folder) if is_run(folder) else {}
    simulated = bool(facts.get("simulated", False))
    rig, calibration = facts.get("rig") or {}, facts.get("calibration") or {}
    provenance = {
        "file": str(file),
        "sha256": data_hash(folder) if is_run(folder) else file_hash(file),
        "repairs": "; ".join(repairs),
        "simulated": str(simulated).lower() if facts else "not stated",
        "address": str(facts.get("address", "")),
        "device_id": str(facts.get("device_id", "")),
        "rig": str(rig.get("name", "")),
        "state": str(facts.get("state", "")),
        "approach": _approach(facts),
        "calibration": str(calibration.get("id", "")),
        "calibration_relative_sd": str(calibration.get("relative_sd", "")),
    }
    return replace(recording, provenance=provenance, simulated=simulated)


def _approach(facts: Mapping[str, Any]) -> str:
    """Return "one side" for a run whose stage came to every place from one side, else nothing.

    A sweep moves every stage but a person so.
    """
    moved_by = ((facts.get("rig") or {}).get("plate") or {}).get("moved_by", "hand")
    stage = (facts.get("plate") or {}).get("stage") or moved_by
    return "" if stage == "hand" else "one side"


def _mismatch(parquet: Path, csv: Path, stated: dict[str, Any]) -> str:
    if stated.get("parquet_sha256") != file_hash(parquet, follow=False):
        return "its hash is not the one in metadata.json"
    if csv.is_file() and stated.get("csv_sha256") != file_hash(csv, follow=False):
        return "samples.csv has changed since it was written"
    return ""


NEEDED = ("theta_ref_rad", "theta_rad", "gyro_rad_s")  # of a pitch experiment

_OTHERS = re.compile(r"pwm\d+_us|rpm\d+|plate_z_m|torque_Nm|disturbance_Nm|voltage_V|thrust_N")


def read_pitch(path: str | Path) -> Recording:
    """Return the experiment of a run that `benchtool record` made, as pitch recordings are.

    Only what was recorded at full collective, not the ramps. time_s is the device's own time since
    then, evenly spaced; a channel without a new value is nan.
    """
    present = sample_names(path)
    for name in NEEDED:
        if name not in present:
            raise FileFormatError(
                str(path), f"there is no {name} in it; name a run of benchtool record"
            )
    wanted = [name for name in present if _OTHERS.fullmatch(name)]
    samples = read_samples(path, ["device_time_us", "phase", *NEEDED, *wanted])
    chosen = samples.select(samples.column("phase") == word_to_code("phase", "sample"))
    if not len(chosen):
        raise FileFormatError(
            str(path), "it ended before the collective was reached; record it again"
        )
    device_us = chosen.column("device_time_us")
    names = [*NEEDED, *wanted]
    pairs = [(Channel("time_s", "s"), 1e-6 * (device_us - device_us[0]))]
    pairs += [(chosen.channels[chosen.index(name)], chosen.column(name)) for name in names]
    return Recording.from_columns(pairs, chosen.provenance, chosen.simulated)


def is_pitch_run(path: str | Path) -> bool:
    """Return whether a run folder holds a pitch experiment, by the channels of its samples."""
    file = Path(path) / "samples.csv"
    return os.path.lexists(file) and "theta_rad" in header_of(file)
