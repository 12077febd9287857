"""Which effects a trend of residuals may stand for, as their hooks show on the model's own rig."""

from __future__ import annotations

import numpy as np

from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.effect import Effect
from benchtool.physics.model import Model

STEP = 0.1  # change of a parameter without a tolerance, in its unit; any shows an influence
SHOWS = 1e-9  # share of the greatest thrust below which a change is that of rounding


def acting_effects(model: Model, conditions: Conditions, column: str) -> tuple[Effect, ...]:
    """Return the effects that residuals trend over a column for, of those that can act there.

    One rotor has no body between rotors, a sweep without times no drift: such an effect's hooks
    change nothing, and nobody is helped by an advice to free it.
    """
    found = (effect for effect in EFFECTS.values() if column in effect.trends_over)
    return tuple(effect for effect in found if has_effect(effect, model, conditions))


def has_effect(effect: Effect, model: Model, conditions: Conditions) -> bool:
    """Whether an effect's numbers move what the model reads under some conditions."""
    if any(present.name == effect.name for present in model.effects):
        model = model.without(effect.name)
    neutral = {item.name: item.neutral for item in effect.parameters if item.neutral is not None}
    moved = {
        item.name: float(np.clip(item.neutral + (item.tolerance or STEP), item.lower, item.upper))
        for item in effect.parameters
        if item.neutral is not None
    }
    absent, present = (
        np.asarray(model.with_effect(effect, **values).thrust_N(conditions), float)
        for values in (neutral, moved)
    )
    return bool(np.max(np.abs(present - absent)) > SHOWS * np.max(np.abs(absent)))
