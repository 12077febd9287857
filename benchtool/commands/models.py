"""`benchtool models`: the models that ship, and what one of them says."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

import typer

from benchtool.commands.shipped import AsToml, show_shipped


def command(
    name: Annotated[
        str,
        typer.Argument(help="A shipped model or the path of a model file; all are listed without."),
    ] = "",
    toml: AsToml = False,
) -> None:
    """List models, or show one with its effects and parameters."""
    show_shipped("model", name, toml, listed=_listed, described=_described)


def _listed() -> Iterator[str]:
    from benchtool.physics import model_file

    for name in model_file.model_names():
        yield f"{name:<16} {model_file.load_model(name).model.description}"


def _described(name: str) -> Iterator[str]:
    from benchtool.commands.terminal.announce_code import announce_code
    from benchtool.physics import model_file

    loaded = model_file.load_model(name, permit=announce_code)
    model = loaded.model
    yield f"{model.name}: {model.description}"
    yield f"rig {model.rig.name}, wake rule {model.wake_rule}, b is the {model.body_distance}"
    effects = ", ".join(effect.name for effect in model.effects) or "none"
    yield f"effects: {effects}"
    yield from (f"note: {note}" for note in loaded.notes)
    for full_name, item in model.parameters.items():
        state = "free " if item.free else "fixed"
        bounds = f"[{item.lower:g}, {item.upper:g}]"
        value = f"{item.value:>12g} {item.unit:<14}"
        yield f"  {full_name:<26} {value} {state} {bounds:<18} {item.source}"
