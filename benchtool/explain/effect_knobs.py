"""Knobs of a bench's candidate effects, and of what the owner of any bench knows of it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from types import MappingProxyType

from benchtool.effects.effect import BenchKind, Effect
from benchtool.effects.model import Model
from benchtool.effects.tolerances import tolerances
from benchtool.explain.knob import Knob

RADIUS_KNOWN = 0.0125
"""Standard error of R_m over its value where a model fixes it and states no prior: the increment
(R/4z)^2 known to 5 %, taken for two standard errors."""


def effect_knobs(
    model: Model,
    names: Collection[str],
    bench: BenchKind,
    least: Mapping[str, float] = MappingProxyType({}),
) -> list[Knob]:
    """Return a knob for each parameter of the named effects that has a tolerance on a bench.

    Args:
        model: holds the effects.
        names: of effects.
        bench: whose tolerances count.
        least: lower bounds by full name of a parameter, where they are above its own.
    """
    found = tolerances(model, bench)
    return [
        Knob(
            name=name,
            unit=item.unit,
            effect=name.split(".")[0],
            start=item.value,
            scale=found[name],
            lower=max(item.lower, least.get(name, item.lower)),
            upper=item.upper,
        )
        for name, item in model.parameters.items()
        if name.split(".")[0] in names and name in found
    ]


def neutral_values(effect: Effect) -> dict[str, float]:
    """Return the values of an effect's parameters at which it is absent, where it has such."""
    return {item.name: item.neutral for item in effect.parameters if item.neutral is not None}
