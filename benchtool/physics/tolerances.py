"""Tolerances of a model: from its file, else defaults of the effects, scaled to the vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from benchtool.core.parameter import Parameters
from benchtool.core.rig import Rig
from benchtool.physics.effects.effect import BenchKind, Effect
from benchtool.physics.model import Model


def default_tolerances(effect: Effect, rig: Rig, bench: BenchKind) -> Mapping[str, float]:
    """Return the default tolerances of an effect on a rig, by short parameter names.

    Parameters without a neutral value (knots, reference speeds) have none, nor have parameters
    without influence on that kind of bench.
    """
    fixed = {item.name: item.tolerance for item in effect.parameters if item.tolerance is not None}
    scaled = effect.tolerance_of(rig, bench) if effect.tolerance_of is not None else {}
    names = {item.name for item in effect.parameters}
    return {name: value for name, value in {**scaled, **fixed}.items() if name in names}


def model_tolerances(model: Model, bench: BenchKind = "pitch") -> Mapping[str, float]:
    """Return all tolerances of a model by full parameter name, in the parameter's unit.

    Tolerances in the model file have precedence over the defaults of the effects.
    """
    values: dict[str, float] = {}
    for effect in model.effects:
        defaults = default_tolerances(effect, model.rig, bench)
        values |= {f"{effect.name}.{name}": value for name, value in defaults.items()}
    values |= {
        name: item.tolerance
        for name, item in model.parameters.items()
        if item.tolerance is not None
    }
    return {name: values[name] for name in model.parameters if name in values}


def with_tolerances(model: Model, bench: BenchKind = "pitch") -> Parameters:
    """Return the parameters of a model with their tolerances filled in."""
    values = model_tolerances(model, bench)
    return Parameters(
        (name, replace(item, tolerance=values.get(name))) for name, item in model.parameters.items()
    )
