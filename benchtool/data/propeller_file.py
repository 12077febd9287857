"""Propellers from TOML files, every number with its source, or from a size."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.rig import Propeller
from benchtool.core.toml_text import build_dataclass, parse_quantities
from benchtool.core.units import to_si
from benchtool.core.user_file import list_names, read_library_file, user_names

FOLDER = "propellers"

_SIZE = re.compile(r"(\d{1,3}(?:\.\d+)?)x(\d{1,3}(?:\.\d+)?)(?:x(\d{1,2}))?")


def propeller_names() -> tuple[str, ...]:
    """Return the names of the propellers in the library and of user-defined ones."""
    return (*list_names(FOLDER), *user_names(FOLDER))


def load_propeller(name_or_path: str | Path) -> Propeller:
    """Return a propeller by name, by the path of its file, or by its size ("10x4.5x3").

    A size is diameter and pitch in inches, and the number of blades.
    """
    text = str(name_or_path)
    if (size := _SIZE.fullmatch(text)) and text not in propeller_names():
        diameter_m, pitch_m = (float(to_si(float(size[part]), "in")) for part in (1, 2))
        blades = int(size[3]) if size[3] else None
        if not diameter_m or not pitch_m or blades not in (None, *range(1, 21)):
            raise InputError(
                f"propeller size {text} is out of range; write inches and 1 to 20 blades, as "
                f"10x4.5x3"
            )
        return Propeller(name=text, diameter_m=diameter_m, pitch_m=pitch_m, blades=blades)
    try:
        return read_propeller(text)[0]
    except UnknownChoice as error:
        raise UnknownChoice(
            "propeller or file (sizes in inches: 10x4.5)",
            text, propeller_names(),
        ) from error  # fmt: skip


def read_propeller(name_or_path: str) -> tuple[Propeller, Mapping[str, str]]:
    """Return a propeller and the source of each of its numbers."""
    text, where = read_library_file("propeller", FOLDER, name_or_path)
    data, sources = parse_quantities(text, where)
    return build_dataclass(Propeller, data, where), sources.by_key
