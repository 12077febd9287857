"""Knobs: the numbers that an explanation may turn, each with what does not matter on the bench."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from benchtool.core.parameter import Parameters

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Knob:
    """Describe one number that an explanation may move.

    Inside, a knob is counted in units of its `scale`, from its `start`: 0 is the model as given
    and 1 is one tolerance away.

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

    def value(self, turned: float) -> float:
        """Return the value of a knob turned by so many scales."""
        return self.start + self.scale * turned


def parameters_at(parameters: Parameters, knobs: Sequence[Knob], turned: Array) -> Parameters:
    """Return parameters with knobs turned (n_knobs,), each within its bounds.

    A knob whose name is no parameter's belongs to the bench, not to the model.
    """
    values = {
        knob.name: float(np.clip(knob.value(z), knob.lower, knob.upper))
        for knob, z in zip(knobs, turned, strict=True)
    }
    return Parameters(
        (name, item.at(values[name]) if name in values else item)
        for name, item in parameters.items()
    )
