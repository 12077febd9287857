"""The rig that data were recorded on: a run folder carries the whole of it."""

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
        metadata: what its metadata.json holds; read when left out.

    Raises:
        FileFormatError: metadata without a rig, or with one that lacks something.
    """
    where = str(Path(folder) / "metadata.json")
    facts = read_metadata(Path(folder)) if metadata is None else metadata
    if not facts.get("rig"):
        raise FileFormatError(where, "it names no rig; restore it from a copy")
    return build_dataclass(Rig, facts["rig"], f"{where}: rig")


def load_rig_for_data(paths: Sequence[str]) -> Rig | None:
    """Return the rig that data were recorded on, None where nothing says it.

    Run folders carry it, a points.csv inside one has that run's, and the JSON beside a simulated
    recording holds it; other files have none.

    Raises:
        InputError: runs of two vehicles, which one model cannot be held against.
    """
    found: dict[str, Rig] = {}
    for path in paths:
        folder = path if Path(path).is_dir() else str(Path(path).parent)
        if is_run(folder):
            found[path] = run_rig(folder)
        elif (side := metadata_path(Path(path))).is_file() and (rig := read_json(side).get("rig")):
            found[path] = build_dataclass(Rig, rig, f"{side}: rig")
    first = next(iter(found), None)
    if first is None:
        return None
    for path, rig in found.items():
        if different := differences(found[first], rig):
            raise InputError(
                f"{first} and {path} are of two vehicles ({different[0]}); give one model the runs "
                f"of one vehicle, and the others a command of their own"
            )
    rig = found[first]
    for other in found.values():
        rig = with_blades_of(rig, other)
    return rig


def with_blades_of(rig: Rig, other: Rig) -> Rig:
    """Return a rig with what it does not say of blades and motors as another one says it.

    Runs may be older than what is known of their propellers.
    """
    return replace(rig, blade=rig.blade or other.blade, motor=rig.motor or other.motor)


def differences(one: Rig, other: Rig) -> tuple[str, ...]:
    """Return in which numbers that a model takes from a rig two rigs differ, in words."""
    found = []
    if one.n_rotors != other.n_rotors:
        found.append(f"{one.n_rotors} rotors against {other.n_rotors}")
    elif any(
        (a.x_m, a.y_m) != (b.x_m, b.y_m) for a, b in zip(one.rotors, other.rotors, strict=True)
    ):
        found.append(f"rotors elsewhere on {one.name!r} and {other.name!r}")
    pairs = {
        "rotor radius": (one.propulsion.radius_m, other.propulsion.radius_m, "m"),
        "thrust coefficient": (
            one.propulsion.thrust_coefficient_N_s2,
            other.propulsion.thrust_coefficient_N_s2,
            "N/(rad/s)2",
        ),
        "half diagonal": (one.body.half_diagonal_m, other.body.half_diagonal_m, "m"),
    }
    found += [
        f"{what} {_shown(a, unit)} against {_shown(b, unit)}"
        for what, (a, b, unit) in pairs.items()
        if a != b
    ]
    for what, one_has, other_has in (
        ("blades", one.blade, other.blade),
        ("motors", one.motor, other.motor),
    ):
        if one_has and other_has and one_has != other_has:
            found.append(f"other {what} on {one.name!r} than on {other.name!r}")
    return tuple(found)


def _shown(value: float | None, unit: str) -> str:
    return "not stated" if value is None else f"{value:g} {unit}"
