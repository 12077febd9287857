"""Model parameters: value, unit, bounds, prior, tolerance, free or fixed."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import NoReturn

import numpy as np

from benchtool.core.choices import PriorKind
from benchtool.core.errors import InputError, UnknownChoice
from benchtool.core.units import Array, find_unit


@dataclass(frozen=True, slots=True)
class Prior:
    """Prior distribution of a parameter.

    Attributes:
        kind: "uniform" within the bounds, or "normal" truncated at the bounds.
        mean, sd: of the normal prior, in the parameter's unit; unused for "uniform".
        source: origin of the numbers (data sheet, calibration, assumed).
    """

    kind: PriorKind = "uniform"
    mean: float = 0.0
    sd: float = 1.0
    source: str = ""

    def __post_init__(self) -> None:
        if self.kind == "normal" and not (self.sd > 0.0 and isfinite(self.mean)):
            raise InputError(
                f"a normal prior needs a finite mean and sd above 0, got {self.mean} and {self.sd}"
            )


@dataclass(frozen=True, slots=True)
class Parameter:
    """Parameter of a model.

    Attributes:
        name: without its effect ("K_b"); the full name in a model is "body_lift.K_b".
        unit: one of `core.units.UNITS`.
        neutral: value at which the effect is exactly absent; None for baseline parameters.
        lower, upper: bounds, infinite if there are none.
        tolerance: smallest change that matters on the bench; None if not stated.
        free: whether a fit estimates it.
    """

    name: str
    unit: str
    value: float
    neutral: float | None = None
    lower: float = -inf
    upper: float = inf
    prior: Prior = Prior()
    tolerance: float | None = None
    free: bool = False
    description: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        find_unit(self.unit)
        if not self.lower <= self.value <= self.upper:
            unit = "" if self.unit == "1" else f" {self.unit}"
            raise InputError(
                f"parameter {self.name} is {self.value:g}{unit}, outside its bounds "
                f"[{self.lower:g}, {self.upper:g}]; move the value or the bounds"
            )

    def with_value(self, value: float) -> Parameter:
        """Return the parameter at another value."""
        return replace(self, value=float(value))

    def as_free(self) -> Parameter:
        """Return the parameter as free in a fit."""
        return replace(self, free=True)

    def as_fixed(self, value: float | None = None) -> Parameter:
        """Return the parameter as fixed in a fit."""
        return replace(self, free=False, value=self.value if value is None else float(value))

    @property
    def is_neutral(self) -> bool:
        """True if the effect is exactly absent at this value."""
        return self.neutral is not None and self.value == self.neutral


def resolve_name(
    name: str, names: Iterable[str], kind: str = "parameter", others: Iterable[str] = ()
) -> str:
    """Return the full name for a name or for its unique last part.

    Args:
        name: "body_lift.K_b", or "K_b" if no other name ends with it.
        kind: noun for the error message.
        others: further valid names, for the error message.

    Raises:
        UnknownChoice: no such name, or an ambiguous last part.
    """
    names = list(names)
    if name in names:
        return name
    matches = [full for full in names if full.rpartition(".")[2] == name]
    if len(matches) == 1:
        return matches[0]
    raise UnknownChoice(kind, name, matches or [*names, *others])


class Parameters(dict[str, Parameter]):
    """Parameters by full name, in fixed order; packs the free ones. Never modified in place."""

    def __missing__(self, name: str) -> NoReturn:
        raise UnknownChoice("parameter", name, self)

    @property
    def free_names(self) -> tuple[str, ...]:
        """Full names of the free parameters, in order."""
        return tuple(name for name, item in self.items() if item.free)

    def values_array(self) -> Array:
        """Return all values (n_parameters,), each in its own unit."""
        return np.array([item.value for item in self.values()], float)

    def pack(self) -> Array:
        """Return the free values (n_free,)."""
        return np.array([item.value for item in self.values() if item.free], float)

    def bounds(self) -> tuple[Array, Array]:
        """Return lower and upper bounds of the free parameters, (n_free,) each."""
        free = [item for item in self.values() if item.free]
        return (
            np.array([item.lower for item in free], float),
            np.array([item.upper for item in free], float),
        )

    def with_replaced(self, name: str, parameter: Parameter) -> Parameters:
        """Return the set with one parameter replaced."""
        self[name]
        return Parameters({**self, name: parameter})

    def with_values(self, free_values: Array) -> Parameters:
        """Return the set with the free parameters at `free_values` (n_free,)."""
        names = self.free_names
        if len(free_values) != len(names):
            raise InputError(f"{len(names)} free parameters, but {len(free_values)} values")
        new = zip(names, free_values, strict=True)
        return Parameters({**self, **{name: self[name].with_value(value) for name, value in new}})
