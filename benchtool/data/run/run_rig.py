"""Rig of recorded data; the metadata of a run contain all of its fields."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchtool.core.errors import FileFormatError, InputError
from benchtool.core.rig import Rig
from benchtool.core.toml_text import build_dataclass
from benchtool.data.atomic import read_json
from benchtool.data.run.read import is_run
from benchtool.data.run.recording_file import metadata_path
from benchtool.data.run.run_metadata import read_metadata


def run_rig(folder: str | Path, metadata: Mapping[str, Any] | None = None) -> Rig:
    """Return the rig of a run folder.

    Args:
        metadata: of the run; default: read from the folder.

    Raises:
        FileFormatError: the rig is missing or incomplete.
    """
    source = str(Path(folder) / "metadata.json")
    facts = read_metadata(Path(folder)) if metadata is None else metadata
    if not facts.get("rig"):
        raise FileFormatError(source, "the table rig is missing; restore the file from a backup")
    return build_dataclass(Rig, facts["rig"], f"{source}: rig")


def load_rig_for_data(paths: Sequence[str]) -> Rig | None:
    """Return the common rig of data files, None if no file has one.

    A run folder, a points.csv in one, and a simulated recording (in its JSON file) have a rig.

    Raises:
        InputError: the rigs differ, so the data cannot share one model.
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
