"""`benchtool effects`: every physical effect that the tool knows."""

from __future__ import annotations

from typing import Annotated

import typer


def command(
    name: Annotated[str, typer.Argument(help="An effect; all are listed without.")] = "",
) -> None:
    """List physical effects, or show one with law and parameters."""
    from benchtool.effects.catalogue import EFFECTS, effect_named

    if not name:
        for effect in EFFECTS.values():
            print(f"{effect.name:<18} {effect.stage:<14} {effect.title}: {effect.law}")
        return
    effect = effect_named(name)
    print(f"{effect.name}: {effect.title} ({effect.stage})")
    print(effect.description)
    print(f"law:    {effect.law}")
    print(f"shows:  {effect.shows}")
    print(f"source: {effect.source}")
    for other, how in effect.confused_with.items():
        print(f"looks like {other}: {how}")
    for item in effect.parameters:
        neutral = "no neutral value" if item.neutral is None else f"neutral {item.neutral:g}"
        tolerance = "" if item.tolerance is None else f", tolerance {item.tolerance:g}"
        print(f"  {item.name} [{item.unit}]: {item.description}; {neutral}{tolerance}")
