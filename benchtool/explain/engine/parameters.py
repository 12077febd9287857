"""The numbers that an explanation may move, each with what does not matter on the bench."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from types import MappingProxyType

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.parameter import Parameter, Parameters, Prior
from benchtool.physics.catalogue import EFFECTS, candidates
from benchtool.physics.effects.effect import BenchKind, Effect
from benchtool.physics.model import Model
from benchtool.physics.tolerances import tolerances


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaledParameter:
    """Describe one number that an explanation may move.

    Inside, it is counted in units of its `scale`, from its `start`: 0 is the model as given and 1
    is one tolerance away.

    Attributes:
        effect: the effect that it belongs to; "" for a number that the bench's owner knows only
            to within a standard error (inertia, the map from pulse to speed).
    """

    name: str  # full name of the model's parameter ("hinge_spring.stiffness_Nm_per_rad")
    unit: str  # of its value
    effect: str
    start: float  # value in the model as given
    scale: float  # tolerance of an effect's parameter; standard error of any other
    lower: float = -inf
    upper: float = inf
    held: bool = False  # whether only its prior holds it, not its tolerance
    first: float = 0.0  # where a search begins, in scales

    @property
    def least(self) -> float:
        """The lower bound in units of the scale."""
        return (self.lower - self.start) / self.scale

    @property
    def most(self) -> float:
        """The upper bound in units of the scale."""
        return (self.upper - self.start) / self.scale

    def value(self, scaled: float) -> float:
        """Return the value so many scales from the start."""
        return self.start + self.scale * scaled


def owner_parameter(
    name: str, item: Parameter, sd: float, lower: float, first: float = 0.0
) -> ScaledParameter:
    """Return the parameter of a number that only its prior holds, known to a standard error."""
    return ScaledParameter(
        name=name, unit=item.unit, effect="", start=item.value, scale=sd, lower=lower,
        upper=item.upper, held=True, first=first,
    )  # fmt: skip


def parameters_at(
    parameters: Parameters, moved: Sequence[ScaledParameter], scaled: Array
) -> Parameters:
    """Return parameters with some moved to scaled values (n_parameters,), each within its bounds.

    What is moved and no parameter of the model belongs to the bench.
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
    """Return a parameter for each parameter of the named effects that has a tolerance on a bench.

    Args:
        least: lower bounds by full name of a parameter, where they are above its own.
    """
    limits = tolerances(model, bench)
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


RADIUS_KNOWN = 0.0125
"""Standard error of R_m over its value where a model fixes it and states no prior: the increment
(R/4z)^2 known to 5 %, taken for two standard errors."""


def with_every_effect(model: Model, bench: BenchKind, extra: Sequence[Effect] = ()) -> Model:
    """Return the model with every effect that an explanation moves on a bench, at its neutral."""
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
    """Return the effects that an explanation may name, then those that it only adjusts."""
    adjusted = [effect for effect in EFFECTS.values() if bench in effect.adjusted_on]
    return (*candidates(bench), *sorted(adjusted, key=lambda effect: effect.name), *extra)


def shape_names(model: Model, effect: Effect, bench: BenchKind) -> list[str]:
    """Return full names of an effect's numbers that nobody knows exactly, held by its priors.

    They shape the law of a candidate, or are all there is of what an explanation only adjusts.
    """
    limits = {} if bench in effect.adjusted_on else tolerances(model, bench)
    full = [f"{effect.name}.{p.name}" for p in effect.parameters if p.prior.kind == "normal"]
    return [name for name in full if name not in limits]


def all_shape_names(model: Model, bench: BenchKind, extra: Sequence[Effect] = ()) -> list[str]:
    """Return those of every effect on a bench: first of what is only adjusted, then by name."""
    effects = sorted(
        moved_effects(bench, extra), key=lambda effect: (effect.candidate, effect.name)
    )
    return [name for effect in effects for name in shape_names(model, effect, bench)]


RADIUS_FITTED = 0.05  # sd of R_m over its value where it is fitted; assumed
K_KNOWN, K_FITTED = 0.01, 0.1  # of k: a load cell's scale is known to 1 %, a rotor's k is not

_SHARES = {"k": (K_KNOWN, K_FITTED), "R_m": (RADIUS_KNOWN, RADIUS_FITTED)}


def known_prior(name: str, item: Parameter) -> Prior | None:
    """Return the normal prior under which a sweep's explanation adjusts a number.

    The stated one, else a share of the value for k and R_m; None for any other without one.
    """
    if item.prior.kind == "normal":
        return item.prior
    if name not in _SHARES:
        return None
    share = _SHARES[name][item.free]
    source = f"assumed by benchtool explain: {100.0 * share:g} % where none is stated"
    return Prior("normal", item.value, share * item.value, source)
