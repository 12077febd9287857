"""Tolerances of a model, and the effects that change its prediction by theirs.

Tolerances are from the model's file, else defaults of the effects, scaled to the vehicle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from benchtool.core.parameter import Parameters
from benchtool.core.rig import Rig
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.effect import BenchKind, Effect
from benchtool.physics.model import Model

STEP = 0.1  # change of a parameter without a tolerance, in its unit; arbitrary
MIN_CHANGE = 1e-9  # of the maximum thrust; smaller changes are rounding errors


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


def find_trend_effects(model: Model, conditions: Conditions, column: str) -> tuple[Effect, ...]:
    """Return the effects that cause residual trends over a column under these conditions.

    Effects without influence are left out: body lift with a single rotor, drift in a sweep without
    times.
    """
    candidates = (effect for effect in EFFECTS.values() if column in effect.trends_over)
    return tuple(effect for effect in candidates if has_effect(effect, model, conditions))


def has_effect(effect: Effect, model: Model, conditions: Conditions) -> bool:
    """Return True if the parameters of an effect change the predicted reading."""
    if any(present.name == effect.name for present in model.effects):
        model = model.without(effect.name)
    neutral = {item.name: item.neutral for item in effect.parameters if item.neutral is not None}
    changed = {
        item.name: float(np.clip(item.neutral + (item.tolerance or STEP), item.lower, item.upper))
        for item in effect.parameters
        if item.neutral is not None
    }
    absent, present = (
        np.asarray(model.with_effect(effect, **values).thrust_N(conditions), float)
        for values in (neutral, changed)
    )
    return bool(np.max(np.abs(present - absent)) > MIN_CHANGE * np.max(np.abs(absent)))
