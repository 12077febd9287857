"""`benchtool models`: the models that ship, and what one of them says."""

from __future__ import annotations

from typing import Annotated

import typer


def command(
    name: Annotated[
        str,
        typer.Argument(help="A shipped model or the path of a model file; all are listed without."),
    ] = "",
    toml: Annotated[
        bool, typer.Option("--toml", help="Print the file itself, to start one of your own.")
    ] = False,
) -> None:
    """List models, or show one with its effects and parameters."""
    from benchtool import library
    from benchtool.library.packaged import read_named

    if not name:
        for each in library.model_names():
            print(f"{each:<16} {library.load_model(each).model.description}")
        return
    if toml:
        print(read_named("model", "models", name)[0], end="")
        return
    model = library.load_model(name).model
    print(f"{model.name}: {model.description}")
    print(f"rig {model.rig.name}, wake rule {model.wake_rule}, b is the {model.body_distance}")
    effects = ", ".join(effect.name for effect in model.effects) or "none beyond eq. (2)"
    print(f"effects: {effects}")
    for full_name, item in model.parameters.items():
        state = "free " if item.free else "fixed"
        bounds = f"[{item.lower:g}, {item.upper:g}]"
        value = f"{item.value:>12g} {item.unit:<14}"
        print(f"  {full_name:<26} {value} {state} {bounds:<18} {item.source}")
