"""Write docs/reference/rig-keys.md from the schema: python docs/reference/write_rig_keys.py"""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin, get_type_hints

from benchtool.core.channel import CHANNELS, unit_from_name
from benchtool.core.inputs import describe_range
from benchtool.core.rig import (
    Blade,
    Body,
    Limits,
    Motor,
    PlateDrive,
    Propeller,
    Propulsion,
    RotorPosition,
    Sensor,
)
from benchtool.core.rig_file import TYPICAL

PAGE = Path(__file__).with_name("rig-keys.md")

HEAD = """# Keys of rig files, and channels

Made from the schema by `docs/reference/write_rig_keys.py`. What a rig file is, and how sources are
written: [rig files](files.md#rig-files). A rig must state `name` and `propulsion.radius_m`. If it
leaves a key out, the number in the last column stands in, marked as not stated; a bench needs its
own `limits.load_cell_rating_N`, `propulsion.pwm_stop_us`, `pwm_start_us` and `pwm_max_us`.
"""

TABLES: dict[str, type[Any]] = {
    "[[rotors]]": RotorPosition,
    "[propulsion]": Propulsion,
    "[propeller]": Propeller,
    "[blade]": Blade,
    "[motor]": Motor,
    "[body]": Body,
    "[sensors.CHANNEL]": Sensor,
    "[plate]": PlateDrive,
    "[limits]": Limits,
}

CHANNEL_HEAD = """
## Channels

Names and units of the `channel` lines of the [bench protocol](bench-protocol.md), of column maps
and of files. `#` is a rotor's number, from 1. A bench may stream others; only these are understood.

| channel | unit | what |
|---|---|---|
"""


def page() -> str:
    """Return the page."""
    parts = [HEAD, *(section(name, table) for name, table in TABLES.items())]
    rows = (f"| `{name}` | {unit(name)} | {words} |\n" for name, words in CHANNELS.items())
    return "\n".join(parts) + CHANNEL_HEAD + "".join(rows)


def unit(name: str) -> str:
    """Return the unit of a channel."""
    own = unit_from_name(name.replace("#", "1"))
    return {"1": "–", "pwm_us": "us"}.get(own, own)


def section(name: str, table: type[Any]) -> str:
    """Return the rows of one table."""
    said, hints = meanings(table), get_type_hints(table, include_extras=True)
    rows = "".join(
        f"| `{item.name}` | {said[item.name]} | {taken(hints[item.name])} | {usual(name, item)} |\n"
        for item in fields(table)
    )
    head = "| key | meaning | takes | when left out |\n|---|---|---|---|\n"
    return f"## `{name}`\n\n{head}{rows}"


def meanings(table: type[Any]) -> dict[str, str]:
    """Return what the docstring says of each key."""
    text = (table.__doc__ or "").partition("Attributes:")[2]
    found = {}
    for names, words in re.findall(r"(?m)^ {8}(\w[\w, ]*): ((?:.|\n {12})+)", text):
        for one in names.split(", "):
            found[one] = " ".join(words.split()).rstrip(".").replace("|", "or")
    return {"name": "name for people", "title": "one line for people"} | found


def taken(hint: Any) -> str:
    """Return which values a key takes."""
    metadata: list[Any] = []
    while get_origin(hint) is not Literal and get_args(hint):
        if get_origin(hint) is Annotated:
            metadata += hint.__metadata__
        hint = get_args(hint)[0]
    if get_origin(hint) is Literal:
        return ", ".join(f"`{value}`" for value in get_args(hint))
    kind = {float: "number", int: "whole number", str: "text", bool: "true or false"}[hint]
    return describe_range(metadata) or kind


def usual(name: str, item: Any) -> str:
    """Return what stands in for a key that is left out."""
    key = f"{name.strip('[]')}.{item.name}"
    if key in TYPICAL:
        return TYPICAL[key][1]
    if isinstance(item.default, str | int | float):
        return f"{item.default}" if item.default != "" else "–"
    if key == "propulsion.radius_m":
        return "refused"
    return "–" if item.default is None else "needed"


if __name__ == "__main__":
    PAGE.write_text(page(), "utf-8")
    print(PAGE)
