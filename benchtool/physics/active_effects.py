"""Effects that can cause a trend of residuals on a model's rig."""

from __future__ import annotations

import numpy as np

from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model

STEP = 0.1  # change of a parameter without a tolerance, in its unit; arbitrary
MIN_CHANGE = 1e-9  # of the maximum thrust; smaller changes are rounding errors


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
