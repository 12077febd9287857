"""`benchtool rigs`: the rigs that ship, and what one of them says."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import typer

from benchtool.commands.shipped import AsToml, show_shipped


def command(
    name: Annotated[
        str, typer.Argument(help="A shipped rig or the path of a rig file; all are listed without.")
    ] = "",
    toml: AsToml = False,
) -> None:
    """List rigs, or show one with the source of every number."""
    show_shipped("rig", name, toml, listed=_listed, described=_described)


def _listed() -> Iterator[str]:
    from benchtool.core import rig_file

    for name in rig_file.rig_names():
        yield f"{name:<14} {rig_file.rig_named(name).title}"


def _described(name: str) -> Iterator[str]:
    from benchtool.core import rig_file

    rig = rig_file.rig_named(name)
    yield f"{rig.name}: {rig.title}"
    yield f"{len(rig.assumed)} of {len(rig.sources)} numbers are assumed (marked ?)"
    for key, source in rig.sources.items():
        mark = "?" if key in rig.assumed else " "
        yield f"{mark} {key:<40} {_value(rig, key):>12}  {source}"


def _value(rig: object, key: str) -> str:
    """Return the number that a dotted key like `rotors[0].x_m` leads to."""
    found: object = rig
    for part in key.replace("[", ".[").split("."):
        if part.startswith("["):
            found = found[int(part[1:-1])]  # type: ignore[index]
        elif isinstance(found, dict):
            found = found[part]
        else:
            found = getattr(found, part)
    return f"{found:g}" if isinstance(found, int | float) else str(found)
