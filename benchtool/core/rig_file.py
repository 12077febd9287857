"""Rigs as TOML files: strict, with a source for every number."""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import tomli_w

from benchtool.core.errors import FileFormatError
from benchtool.core.packaged import packaged_names, read_named
from benchtool.core.parsed_text import parse_toml
from benchtool.core.rig import Rig
from benchtool.core.toml_text import (
    Sources,
    build,
    require_sources,
    unwrap_quantities,
)


def rig_names() -> tuple[str, ...]:
    """Return the names of the rigs that benchtool ships."""
    return packaged_names("rigs")


@lru_cache(maxsize=32)
def _packaged_rig(name: str) -> Rig:
    return rig_from_toml(*read_named("rig", "rigs", name))


def rig_named(name_or_path: str | Path) -> Rig:
    """Return a shipped rig by name, or a user's own by the path of its TOML file."""
    if str(name_or_path) in rig_names():
        return _packaged_rig(str(name_or_path))
    return rig_from_toml(*read_named("rig", "rigs", name_or_path))


def rig_from_toml(text: str, where: str) -> Rig:
    """Return the rig that TOML text describes.

    Raises:
        UnknownChoice: a key that a rig has not.
        FileFormatError: a number without a source, of the wrong type, or out of range.
    """
    found = Sources()
    data = unwrap_quantities(parse_toml(text, where), found)
    data.pop("source", None)
    require_sources(found, where)
    rig = build(Rig, data, where)
    rig = replace(rig, sources=found.by_key, assumed=tuple(found.assumed))
    _check(rig, where)
    return rig


SAME_DIAMETER = 0.01
"""A propeller whose diameter is that close to the rig's is the one on it: names are rounded."""


def _check(rig: Rig, where: str) -> None:
    limits, plate, propulsion = rig.limits, rig.plate, rig.propulsion
    if limits.thrust_N > limits.load_cell_rating_N:
        raise FileFormatError(
            where,
            f"limits.thrust_N is {limits.thrust_N:g} N, above the load cell's rating of "
            f"{limits.load_cell_rating_N:g} N; lower the limit",
        )
    if not plate.z_min_m < plate.z_max_m:
        raise FileFormatError(
            where,
            f"plate.z_min_m {plate.z_min_m:g} is not below plate.z_max_m {plate.z_max_m:g}; "
            f"swap or correct them",
        )
    if not propulsion.pwm_stop_us <= propulsion.pwm_start_us < propulsion.pwm_max_us:
        raise FileFormatError(
            where,
            "propulsion needs pwm_stop_us <= pwm_start_us < pwm_max_us, got "
            f"{propulsion.pwm_stop_us:g}, {propulsion.pwm_start_us:g}, {propulsion.pwm_max_us:g}",
        )
    propeller, diameter_m = rig.propeller, 2.0 * propulsion.radius_m
    if propeller and abs(propeller.diameter_m / diameter_m - 1.0) > SAME_DIAMETER:
        raise FileFormatError(
            where,
            f"propeller.diameter_m is {propeller.diameter_m:g} m, but propulsion.radius_m makes "
            f"{diameter_m:g} m; correct one of them",
        )
    motor = rig.motor
    if motor and not motor.governed and not motor.has_curve:
        raise FileFormatError(
            where,
            "motor needs Kv_rpm_V and resistance_ohm, or governed = true where the ESC holds "
            "the speed; add them, or take the table out",
        )


RIG_FILE = "rig.toml"
"""Name of a rig's file beside the model that names it."""


def rig_beside(rig: Rig) -> tuple[str, str]:
    """Return how a new model file names a rig, and the text of the file `RIG_FILE` beside it.

    The text is empty for a rig that benchtool ships with these very numbers.
    """
    if rig.name in rig_names():
        shipped = replace(_packaged_rig(rig.name), sources=rig.sources, assumed=rig.assumed)
        if shipped == rig:
            return rig.name, ""
    return RIG_FILE, rig_to_toml(rig)


def rig_to_toml(rig: Rig) -> str:
    """Return a rig as TOML text that reads back to the same rig."""
    tables = asdict(rig)
    del tables["sources"], tables["assumed"]
    return tomli_w.dumps(
        {key: _with_source(value, key, rig) for key, value in tables.items() if value is not None}
    )


def _with_source(value: Any, key: str, rig: Rig) -> Any:
    """Return a value of a rig with its numbers written as quantities, by its dotted key."""
    if isinstance(value, dict):
        return {
            name: _with_source(item, f"{key}.{name}", rig)
            for name, item in value.items()
            if item is not None
        }
    if isinstance(value, list | tuple):
        return [_with_source(item, f"{key}[{place}]", rig) for place, item in enumerate(value)]
    if isinstance(value, str):
        return value
    source = rig.sources.get(key) or "the rig of the run"
    return {"value": value, "source": source, "assumed": key in rig.assumed}


def rig_to_dict(rig: Rig) -> dict[str, Any]:
    """Return a rig as plain tables, for a run's metadata."""
    return asdict(rig)
