"""Knobs of a bench's candidate effects, and of what the owner of any bench knows of it."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType

from benchtool.explain.engine.knob import Knob
from benchtool.physics.catalogue import EFFECTS, candidates
from benchtool.physics.effects.effect import BenchKind, Effect
from benchtool.physics.model import Model
from benchtool.physics.tolerances import tolerances

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


def with_every_effect(model: Model, bench: BenchKind, extra: Sequence[Effect] = ()) -> Model:
    """Return the model with every effect that an explanation moves on a bench, at its neutral.

    Args:
        model: as given by the user.
        bench: whose effects count.
        extra: effects of the user's own.
    """
    have = {effect.name for effect in model.effects}
    for effect in moved_effects(bench, extra):
        if effect.name not in have:
            neutral = {p.name: p.neutral for p in effect.parameters if p.neutral is not None}
            model = model.with_effect(effect, **neutral)
    for effect in model.effects:
        shapes = shape_names(model, effect, bench)
        stated = any(model.parameters[name].value != 0.0 for name in shapes)
        if effect.rig_values is None or (effect.name in have and (stated or not shapes)):
            continue
        for name, value in effect.rig_values(model.rig).items():
            model = model.fixed(f"{effect.name}.{name}", value)
    return model


def moved_effects(bench: BenchKind, extra: Sequence[Effect] = ()) -> tuple[Effect, ...]:
    """Return the effects that an explanation may name, then those that it only adjusts."""
    adjusted = [effect for effect in EFFECTS.values() if bench in effect.adjusted_on]
    return (*candidates(bench), *sorted(adjusted, key=lambda effect: effect.name), *extra)


def shape_names(model: Model, effect: Effect, bench: BenchKind) -> list[str]:
    """Return full names of an effect's numbers that nobody knows exactly, held by its priors.

    They shape the law of a candidate, or are all there is of what an explanation only adjusts.
    """
    shown = {} if bench in effect.adjusted_on else tolerances(model, bench)
    full = [f"{effect.name}.{p.name}" for p in effect.parameters if p.prior.kind == "normal"]
    return [name for name in full if name not in shown]


def all_shape_names(model: Model, bench: BenchKind, extra: Sequence[Effect] = ()) -> list[str]:
    """Return those of every effect on a bench: first of what is only adjusted, then by name."""
    effects = sorted(moved_effects(bench, extra), key=lambda one: (one.candidate, one.name))
    return [name for effect in effects for name in shape_names(model, effect, bench)]
