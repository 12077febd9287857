"""Tolerances of a model: what its file states, else what the effects say for a vehicle this big."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from benchtool.core.parameter import Parameters
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import BenchKind, Effect
from benchtool.physics.model import Model


def default_tolerances(effect: Effect, rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the effect's own tolerances on a rig, by its parameters' own names.

    Parameters that carry no neutral value (knots, reference speeds) have none, and on a bench
    where a parameter does not show it has none either.
    """
    stated = {item.name: item.tolerance for item in effect.parameters if item.tolerance is not None}
    scaled = effect.tolerance_of(rig, bench) if effect.tolerance_of is not None else {}
    names = {item.name for item in effect.parameters}
    return {name: value for name, value in {**scaled, **stated}.items() if name in names}


def tolerances(model: Model, bench: BenchKind = "pitch") -> Mapping[str, float]:
    """Return every tolerance of a model by the parameter's full name, in the parameter's unit.

    What the model file states goes before what the effect says for the model's rig.
    """
    found: dict[str, float] = {}
    for effect in model.effects:
        defaults = default_tolerances(effect, model.rig, bench)
        found |= {f"{effect.name}.{name}": value for name, value in defaults.items()}
    found |= {
        name: item.tolerance
        for name, item in model.parameters.items()
        if item.tolerance is not None
    }
    return {name: found[name] for name in model.parameters if name in found}


def with_tolerances(model: Model, bench: BenchKind = "pitch") -> Parameters:
    """Return the model's parameters, each with its tolerance stated where it has one."""
    known = tolerances(model, bench)
    return Parameters(
        (name, replace(item, tolerance=known.get(name))) for name, item in model.parameters.items()
    )
