"""`benchtool rigs`: the rigs that ship, and what one of them says."""

from __future__ import annotations

from typing import Annotated

import typer


def command(
    name: Annotated[
        str, typer.Argument(help="A shipped rig or the path of a rig file; all are listed without.")
    ] = "",
    toml: Annotated[
        bool, typer.Option("--toml", help="Print the file itself, to start one of your own.")
    ] = False,
) -> None:
    """List rigs, or show one with the source of every number."""
    from benchtool import library
    from benchtool.library.packaged import read_named

    if not name:
        for each in library.rig_names():
            print(f"{each:<14} {library.rig_named(each).title}")
        return
    rig = library.rig_named(name)
    if toml:
        print(read_named("rig", "rigs", name)[0], end="")
        return
    print(f"{rig.name}: {rig.title}")
    print(f"{len(rig.assumed)} of {len(rig.sources)} numbers are assumed (marked ?)")
    for key, source in rig.sources.items():
        print(f"{'?' if key in rig.assumed else ' '} {key:<40} {_value(rig, key):>12}  {source}")


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
