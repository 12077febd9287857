"""Adjustable parameters of an explanation, with their tolerances."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from types import MappingProxyType

import numpy as np

from benchtool.core.parameter import Parameter, Parameters, Prior
from benchtool.core.units import Array
from benchtool.physics.catalogue import EFFECTS, candidates
from benchtool.physics.effects.effect import BenchKind, Effect
from benchtool.physics.model import Model
from benchtool.physics.tolerances import model_tolerances


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaledParameter:
    """Adjustable parameter; a scaled value of 0 is the model as given, 1 is one `scale` above."""

    name: str  # full name of the model's parameter ("hinge_spring.stiffness_Nm_per_rad")
    unit: str
    effect: str  # "" for roughly known parameters (inertia, map from pulse width to speed)
    start: float  # value in the model as given
    scale: float  # tolerance of an effect's parameter; standard error of any other
    lower: float = -inf
    upper: float = inf
    held: bool = False  # roughly known: limited by its prior, without a tolerance
    first: float = 0.0  # initial value of a search, in scales

    @property
    def least(self) -> float:
        """Lower bound, in scales."""
        return (self.lower - self.start) / self.scale

    @property
    def most(self) -> float:
        """Upper bound, in scales."""
        return (self.upper - self.start) / self.scale

    def value(self, scaled: float) -> float:
        """Return the value of a scaled value."""
        return self.start + self.scale * scaled


def owner_parameter(
    name: str, item: Parameter, sd: float, lower: float, first: float = 0.0
) -> ScaledParameter:
    """Return a parameter of the bench, not of an effect; `sd` is its scale."""
    return ScaledParameter(
        name=name, unit=item.unit, effect="", start=item.value, scale=sd, lower=lower,
        upper=item.upper, held=True, first=first,
    )  # fmt: skip


def parameters_at(
    parameters: Parameters, moved: Sequence[ScaledParameter], scaled: Array
) -> Parameters:
    """Return parameters with some set to scaled values (n_parameters,), clipped to their bounds.

    Adjusted parameters that are not in the model belong to the bench and are ignored.
    """
    values = {
        item.name: float(np.clip(item.value(z), item.lower, item.upper))
        for item, z in zip(moved, scaled, strict=True)
    }
    return Parameters(
        (name, item.with_value(values[name]) if name in values else item)
        for name, item in parameters.items()
    )


def effect_parameters(
    model: Model,
    names: Collection[str],
    bench: BenchKind,
    min_values: Mapping[str, float] = MappingProxyType({}),
) -> list[ScaledParameter]:
    """Return the parameters of effects that have a tolerance on a bench.

    `min_values` are lower bounds by full name that are above the parameters' own.
    """
    limits = model_tolerances(model, bench)
    return [
        ScaledParameter(
            name=name,
            unit=item.unit,
            effect=name.split(".")[0],
            start=item.value,
            scale=limits[name],
            lower=max(item.lower, min_values.get(name, item.lower)),
            upper=item.upper,
        )
        for name, item in model.parameters.items()
        if name.split(".")[0] in names and name in limits
    ]


# Relative standard error of a fixed R_m without prior; two of them are 5 % of (R/4z)^2
RADIUS_KNOWN = 0.0125


def with_every_effect(model: Model, bench: BenchKind, extra: Sequence[Effect] = ()) -> Model:
    """Return the model with every adjustable effect of a bench, new ones at their neutral value."""
    present = {effect.name for effect in model.effects}
    for effect in moved_effects(bench, extra):
        if effect.name not in present:
            neutral = {p.name: p.neutral for p in effect.parameters if p.neutral is not None}
            model = model.with_effect(effect, **neutral)
    for effect in model.effects:
        shapes = shape_names(model, effect, bench)
        is_set = any(model.parameters[name].value != 0.0 for name in shapes)
        if effect.rig_values is None or (effect.name in present and (is_set or not shapes)):
            continue
        for name, value in effect.rig_values(model.rig).items():
            model = model.with_fixed(f"{effect.name}.{name}", value)
    return model


def moved_effects(bench: BenchKind, extra: Sequence[Effect] = ()) -> tuple[Effect, ...]:
    """Return the candidate effects, then those that are only adjusted."""
    adjusted = [effect for effect in EFFECTS.values() if bench in effect.adjusted_on]
    return (*candidates(bench), *sorted(adjusted, key=lambda effect: effect.name), *extra)


def shape_names(model: Model, effect: Effect, bench: BenchKind) -> list[str]:
    """Return full names of an effect's roughly known parameters, limited by their priors.

    Shape parameters of a candidate's law, or all parameters of an effect that is only adjusted.
    """
    limits = {} if bench in effect.adjusted_on else model_tolerances(model, bench)
    full = [f"{effect.name}.{p.name}" for p in effect.parameters if p.prior.kind == "normal"]
    return [name for name in full if name not in limits]


def all_shape_names(model: Model, bench: BenchKind, extra: Sequence[Effect] = ()) -> list[str]:
    """Return those of every effect on a bench: first of the adjusted ones, then by name."""
    effects = moved_effects(bench, extra)
    effects = tuple(sorted(effects, key=lambda effect: (bool(effect.benches), effect.name)))
    return [name for effect in effects for name in shape_names(model, effect, bench)]


RADIUS_FITTED = 0.05  # relative sd of R_m if fitted; assumed
K_KNOWN, K_FITTED = 0.01, 0.1  # relative sd of k: scale of the load cell, or fitted

_SHARES = {"k": (K_KNOWN, K_FITTED), "R_m": (RADIUS_KNOWN, RADIUS_FITTED)}


def known_prior(name: str, item: Parameter) -> Prior | None:
    """Return a parameter's normal prior in a sweep; else an assumed one for k and R_m, or None."""
    if item.prior.kind == "normal":
        return item.prior
    if name not in _SHARES:
        return None
    share = _SHARES[name][item.free]
    source = f"assumed by benchtool explain: {100.0 * share:g} % where none is stated"
    return Prior("normal", item.value, share * item.value, source)
