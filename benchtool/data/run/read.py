"""Readers of run folders: rig, points, settings and samples, as recordings with provenance."""

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
from benchtool.core.errors import BenchtoolError, DataWarning, FileFormatError, InputError
from benchtool.core.recording import Recording
from benchtool.core.rig import Rig
from benchtool.core.toml_text import build_dataclass
from benchtool.data.atomic import data_hash, file_hash, read_json
from benchtool.data.columns import check_numbers, word_to_code
from benchtool.data.parquet import parquet_names, read_header, read_parquet, read_stream
from benchtool.data.run.recording_file import metadata_path
from benchtool.data.run.run_metadata import read_metadata
from benchtool.data.table import read_own_table


def is_run(path: str | Path) -> bool:
    """Return whether a path is a run folder."""
    return os.path.lexists(Path(path) / "metadata.json")


PARTS = "parts"  # folder of a merged run with copies of the original runs


def find_parts(path: str | Path) -> tuple[str, ...]:
    """Return the parts of a merged run in their order; the path itself of any other run."""
    sources = read_metadata(Path(path)).get("merged_from") if is_run(path) else None
    if not sources:
        return (str(path),)
    folder = Path(path) / PARTS
    items = folder.iterdir() if folder.is_dir() and not folder.is_symlink() else ()
    names = sorted(item.name for item in items if is_run(item) and not item.is_symlink())
    if names != (expected := [str(source["run"]) for source in sources]):
        different = sorted({*expected} ^ {*names})
        raise FileFormatError(
            f"{path}/{PARTS}",
            f"it contains {len(names)} of the {len(expected)} runs in metadata.json "
            f"({different[0]} differs); restore it from a backup, or merge again",
        )
    return tuple(str(folder / name) for name in names)


def read_points(
    path: str | Path, kinds: Iterable[str] = ("measure", "reference", "anchor")
) -> Recording:
    """Return the points of some kinds (`columns.KINDS`) of a run folder, or of any points.csv."""
    recording = read_own_recording(path, "points.csv")
    for warning in changed_points(path):
        warnings.warn(warning, DataWarning, stacklevel=1)  # shown once for all callers
    if "kind" not in recording:
        return recording
    codes = [word_to_code("kind", kind) for kind in kinds]
    selected = recording.select(np.isin(recording.column("kind"), codes))
    if not len(selected):
        raise FileFormatError(
            str(path), f"no point of kind {', '.join(kinds)} in it; wait for the sweep or resume it"
        )
    return selected


def changed_points(path: str | Path) -> tuple[str, ...]:
    """Return a warning if points.csv (or that of a run) differs from its hash in the metadata."""
    file = Path(path) / "points.csv" if os.path.isdir(path) else Path(path)
    if file.name != "points.csv" or not file.is_file() or not is_run(file.parent):
        return ()
    expected = (read_metadata(file.parent).get("points") or {}).get("csv_sha256")
    if not expected or expected == file_hash(file, follow=file == Path(path)):
        return ()
    return (
        f"{file} has changed since the run was closed; restore it from a backup; document an "
        f"intended edit with benchtool runs note, or edit a table made with benchtool runs "
        f"export --table points",
    )


def read_own_recording(path: str | Path, name: str) -> Recording:
    """Return the table `name` of a run folder, or any file of that kind, with its provenance."""
    return _read(_find_file(path, name), Path(path))


def read_samples(path: str | Path, names: Sequence[str] | None = None) -> Recording:
    """Return the samples of a run folder, or of any samples.csv.

    samples.parquet is preferred if its hash matches the metadata; otherwise samples.csv is read,
    with a warning. One hour at 1 kHz takes 29 MB per column.

    `names` are the columns to read, missing ones are ignored; default: all.
    """
    path = Path(path)
    parquet = path / "samples.parquet"
    if is_run(path) and parquet.is_file():
        hashes, csv = read_metadata(path).get("samples") or {}, path / "samples.csv"
        if hashes.get("parquet_sha256") != file_hash(parquet, follow=False):
            problem = "its hash differs from metadata.json"
        elif csv.is_file() and hashes.get("csv_sha256") != file_hash(csv, follow=False):
            problem = "samples.csv has changed since it was written"
        else:
            return _with_provenance(read_parquet(parquet, names), parquet, path, ())
        text = f"{parquet}: {problem}; samples.csv was read instead"
        warnings.warn(text, DataWarning, stacklevel=1)
        recording = _read_samples(csv, path, names)
        repairs = "; ".join(filter(None, (recording.provenance["repairs"], problem)))
        return replace(recording, provenance={**recording.provenance, "repairs": repairs})
    return _read_samples(_find_file(path, "samples.csv"), path, names)


def sample_names(path: str | Path) -> tuple[str, ...]:
    """Return the column names of the samples of a run folder, or of any samples.csv."""
    parquet = Path(path) / "samples.parquet"
    if parquet.is_file() and not os.path.lexists(Path(path) / "samples.csv"):
        return parquet_names(parquet)
    return read_header(_find_file(path, "samples.csv"), follow=not Path(path).is_dir())


def _find_file(path: str | Path, name: str) -> Path:
    """Return the file itself, or that of a run folder."""
    path = Path(path)
    if not os.path.lexists(path):
        raise FileFormatError(str(path), "there is no such run or file; check the path")
    if not os.path.isdir(path):
        return path
    if not os.path.lexists(path / name):
        contents = ", ".join(sorted(item.name for item in path.iterdir())[:8]) or "none"
        remedy = "use benchtool runs close" if is_run(path) else "give a run folder"
        raise FileFormatError(str(path), f"{name} is missing (contents: {contents}); {remedy}")
    return path / name


def _read(file: Path, path: Path) -> Recording:
    recording, repairs = read_own_table(file, follow=not path.is_dir())
    return _with_provenance(recording, file, path, repairs)


def _read_samples(file: Path, path: Path, names: Sequence[str] | None) -> Recording:
    try:
        recording, repairs = read_stream(file, names)
    except BenchtoolError:
        # Fallback for tables that benchtool has not written; errors name the line.
        recording = _read(file, path)
        return recording if names is None else recording.drop({*recording.names} - {*names})
    return _with_provenance(recording, file, path, repairs)


def _with_provenance(
    recording: Recording, file: Path, path: Path, repairs: tuple[str, ...]
) -> Recording:
    check_numbers(recording, str(file))
    folder = path if path.is_dir() else path.parent
    facts: dict[str, Any] = read_metadata(folder) if is_run(folder) else {}
    simulated = bool(facts.get("simulated", False))
    rig, calibration = facts.get("rig") or {}, facts.get("calibration") or {}
    moved_by = (rig.get("plate") or {}).get("moved_by", "hand")
    stage = (facts.get("plate") or {}).get("stage") or moved_by
    provenance = {
        "file": str(file),
        "sha256": data_hash(folder) if is_run(folder) else file_hash(file),
        "repairs": "; ".join(repairs),
        "simulated": str(simulated).lower() if facts else "not stated",
        "address": str(facts.get("address", "")),
        "device_id": str(facts.get("device_id", "")),
        "rig": str(rig.get("name", "")),
        "state": str(facts.get("state", "")),
        # "one side" if the stage approached all positions from one side: with all but a manual one
        "approach": "" if stage == "hand" else "one side",
        "calibration": str(calibration.get("id", "")),
        "calibration_relative_sd": str(calibration.get("relative_sd", "")),
    }
    return replace(recording, provenance=provenance, simulated=simulated)


PITCH_CHANNELS = ("theta_ref_rad", "theta_rad", "gyro_rad_s")  # of a pitch experiment

_OPTIONAL = re.compile(r"pwm\d+_us|rpm\d+|plate_z_m|torque_Nm|disturbance_Nm|voltage_V|thrust_N")


def read_pitch(path: str | Path) -> Recording:
    """Return the pitch recording of a run of `benchtool record`.

    It has only samples at full collective, not the ramps. time_s is device time from its start; a
    channel without a new value is nan.
    """
    present_names = sample_names(path)
    for name in PITCH_CHANNELS:
        if name not in present_names:
            raise FileFormatError(
                str(path), f"channel {name} is missing; give a run of benchtool record"
            )
    names = [*PITCH_CHANNELS, *filter(_OPTIONAL.fullmatch, present_names)]
    samples = read_samples(path, ["device_time_us", "phase", *names])
    samples = samples.select(samples.column("phase") == word_to_code("phase", "sample"))
    if not len(samples):
        raise FileFormatError(
            str(path), "it ended before the collective was reached; record it again"
        )
    device_us = samples.column("device_time_us")
    pairs = [(Channel("time_s", "s"), 1e-6 * (device_us - device_us[0]))]
    pairs += [(samples.channels[samples.index(name)], samples.column(name)) for name in names]
    return Recording.from_columns(pairs, samples.provenance, samples.simulated)


def is_pitch_run(path: str | Path) -> bool:
    """Return whether a run folder is a pitch experiment, by the channels of its samples."""
    file = Path(path) / "samples.csv"
    return os.path.lexists(file) and "theta_rad" in read_header(file)


def run_rig(folder: str | Path, metadata: Mapping[str, Any] | None = None) -> Rig:
    """Return the rig of a run folder."""
    source = str(Path(folder) / "metadata.json")
    facts = read_metadata(Path(folder)) if metadata is None else metadata
    if not facts.get("rig"):
        raise FileFormatError(source, "the table rig is missing; restore the file from a backup")
    return build_dataclass(Rig, facts["rig"], f"{source}: rig")


def load_rig_for_data(paths: Sequence[str]) -> Rig | None:
    """Return the common rig of data files, None if no file has one.

    A run folder, a points.csv in one, and a simulated recording (in its JSON file) have a rig.
    Raises InputError if the rigs differ, so that the data cannot share one model.
    """
    rigs: dict[str, Rig] = {}
    for path in paths:
        folder = path if Path(path).is_dir() else str(Path(path).parent)
        if is_run(folder):
            rigs[path] = run_rig(folder)
        elif (json := metadata_path(Path(path))).is_file() and (rig := read_json(json).get("rig")):
            rigs[path] = build_dataclass(Rig, rig, f"{json}: rig")
    first = next(iter(rigs), None)
    if first is None:
        return None
    for path, rig in rigs.items():
        if different := find_differences(rigs[first], rig):
            raise InputError(
                f"{first} and {path} have different rigs ({different[0]}); use a separate command "
                f"for each rig"
            )
    rig = rigs[first]
    for other in rigs.values():
        rig = fill_missing_parts(rig, other)
    return rig


def fill_missing_parts(rig: Rig, other: Rig) -> Rig:
    """Return a rig with missing data of blades and motors taken from another rig.

    The metadata of old runs may lack data of their propellers.
    """
    return replace(rig, blade=rig.blade or other.blade, motor=rig.motor or other.motor)


def find_differences(rig: Rig, other: Rig) -> tuple[str, ...]:
    """Return the differences of two rigs in values that models use, as phrases."""
    texts = []
    if rig.n_rotors != other.n_rotors:
        texts.append(f"number of rotors {rig.n_rotors} and {other.n_rotors}")
    elif any(
        (a.x_m, a.y_m) != (b.x_m, b.y_m) for a, b in zip(rig.rotors, other.rotors, strict=True)
    ):
        texts.append(f"different rotor positions of {rig.name!r} and {other.name!r}")
    p, q = rig.propulsion, other.propulsion
    unit = "N/(rad/s)2"
    pairs = {
        "rotor radius": (p.radius_m, q.radius_m, "m"),
        "thrust coefficient": (p.thrust_coefficient_N_s2, q.thrust_coefficient_N_s2, unit),
        "half diagonal": (rig.body.half_diagonal_m, other.body.half_diagonal_m, "m"),
    }
    texts += [
        f"{quantity} {_format(a, unit)} and {_format(b, unit)}"
        for quantity, (a, b, unit) in pairs.items()
        if a != b
    ]
    for name, ours, others in (
        ("blades", rig.blade, other.blade),
        ("motors", rig.motor, other.motor),
    ):
        if ours and others and ours != others:
            texts.append(f"different {name} of {rig.name!r} and {other.name!r}")
    return tuple(texts)


def _format(value: float | None, unit: str) -> str:
    return "unknown" if value is None else f"{value:g} {unit}"
