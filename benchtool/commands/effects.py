"""`benchtool effects`: every physical effect that the tool knows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from benchtool.commands.declared import declared
from benchtool.core.inputs import Input, Inputs


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectsInputs(Inputs):
    """What `benchtool effects` takes."""

    name: Annotated[str, Input("An effect; all are listed without.", argument="NAME")] = ""
    rig: Annotated[str, Input("Whose tolerances to show: shipped rig or TOML file.")] = "beam"


def effects(inputs: EffectsInputs) -> None:
    """List physical effects, or show one with law and parameters."""
    from benchtool.core.rig_file import rig_named
    from benchtool.physics.catalogue import EFFECTS, effect_named
    from benchtool.physics.effects.effect import BENCH_KINDS
    from benchtool.physics.tolerances import default_tolerances

    name, rig = inputs.name, inputs.rig
    if not name:
        for effect in EFFECTS.values():
            print(f"{effect.name:<18} {effect.subsystem:<14} {effect.title}: {effect.law}")
        return
    effect, own = effect_named(name), rig_named(rig)
    print(f"{effect.name}: {effect.title} ({effect.subsystem})")
    print(effect.description)
    print(f"law:    {effect.law}")
    print(f"shows:  {effect.shows}")
    print(f"source: {effect.source}")
    for other, how in effect.confused_with.items():
        print(f"looks like {other}: {how}")
    shown = [bench for bench in BENCH_KINDS if bench in effect.benches]
    print(f"candidate on: {' and '.join(f'{bench} benches' for bench in shown) or 'no bench'}")
    known = {bench: default_tolerances(effect, own, bench) for bench in shown or BENCH_KINDS[:1]}
    for item in effect.parameters:
        neutral = "no neutral value" if item.neutral is None else f"neutral {item.neutral:g}"
        matters = [
            f"{one[item.name]:.3g} ({bench})" for bench, one in known.items() if item.name in one
        ]
        tolerance = f"; tolerance on {rig}: {', '.join(matters)}" if matters else ""
        print(f"  {item.name} [{item.unit}]: {item.description}; {neutral}{tolerance}")


command = declared(EffectsInputs, effects)
