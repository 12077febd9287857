"""The numbers that an explanation may move, each with what does not matter on the bench."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from math import inf
from types import MappingProxyType

import numpy as np

from benchtool.core.array import Array
from benchtool.core.parameter import Parameters
from benchtool.physics.effects.effect import BenchKind
from benchtool.physics.model import Model
from benchtool.physics.tolerances import tolerances


@dataclass(frozen=True, slots=True, kw_only=True)
class ScaledParameter:
    """Describe one number that an explanation may move.

    Inside, it is counted in units of its `scale`, from its `start`: 0 is the model as given and 1
    is one tolerance away.

    Attributes:
        name: full name of the model's parameter ("hinge_spring.stiffness_Nm_per_rad").
        unit: of its value.
        effect: the effect that it belongs to; "" for a number that the bench's owner knows only
            to within a standard error (inertia, the map from pulse to speed).
        start: value in the model as given.
        scale: tolerance of an effect's parameter; standard error of any other.
        lower, upper: bounds of the value.
        first: where a search begins, in scales.
        held: whether only its prior holds it, not its tolerance.
    """

    name: str
    unit: str
    effect: str
    start: float
    scale: float
    lower: float = -inf
    upper: float = inf
    held: bool = False
    first: float = 0.0

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


def parameters_at(
    parameters: Parameters, moved: Sequence[ScaledParameter], scaled: Array
) -> Parameters:
    """Return parameters with some moved to scaled values (n_parameters,), each within its bounds.

    What is moved and no parameter of the model belongs to the bench.
    """
    values = {
        one.name: float(np.clip(one.value(z), one.lower, one.upper))
        for one, z in zip(moved, scaled, strict=True)
    }
    return Parameters(
        (name, item.at(values[name]) if name in values else item)
        for name, item in parameters.items()
    )


def effect_parameters(
    model: Model,
    names: Collection[str],
    bench: BenchKind,
    least: Mapping[str, float] = MappingProxyType({}),
) -> list[ScaledParameter]:
    """Return a parameter for each parameter of the named effects that has a tolerance on a bench.

    Args:
        model: holds the effects.
        names: of effects.
        bench: whose tolerances count.
        least: lower bounds by full name of a parameter, where they are above its own.
    """
    found = tolerances(model, bench)
    return [
        ScaledParameter(
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
