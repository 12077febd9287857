"""Dependence of an unnamed effect on a variable, with its law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchtool.core.units import Array
from benchtool.explain.law_search.families import LawFamily, Scale
from benchtool.physics.effects.effect import BenchKind

Hook = Literal["factor", "thrust_reading", "torque", "gyro_reading"]  # hooks of drafted effects
DISTANCE = "flow.height_m[i] / p.radius_m"  # plate distance over radius, in the code of a hook


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Variable:
    """Dimensionless variable of a law."""

    phrase: str  # within a sentence
    symbol: str  # in a formula
    values: Array  # (m,) one for each reading
    code: str = ""  # of a hook, with `p.reference` for the reference
    reference: float = 1.0  # divisor of the quantity, in `unit`
    unit: str = "1"
    scale: Scale = "positive"
    forms: tuple[str, ...] = ("factor", "near", "nearer", "reading")  # suitable ones
    is_categorical: bool = False  # categorical: values are independent groups


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LawForm:
    """Target of a law: a reading, torque or thrust changes by a f(u) times weights (m,)."""

    name: str
    hook: Hook | Literal[""]
    weights: Array
    formula: str  # with {f} for a f(u)
    code: str  # of the hook's result, with {f} for f(u) and `p.typical` for the unit of a
    tolerance: float  # tolerance of the weighted law
    bench: BenchKind = "sweep"
    unit: str = "N"  # of `weights`
    centred: bool = False  # subtract the law's mean, which other parameters absorb
    phrase: str = ""  # location, within a sentence
    quantity: str = "thrust"  # quantity of which values are a share, for an axis

    def affected_values(self, variable: Variable) -> Array:
        """Return the values of a variable at the readings that the form changes."""
        values: Array = variable.values[np.abs(self.weights) > 0.02 * np.abs(self.weights).max()]
        return values


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Law:
    """Law a f(u) with its parameters."""

    family: LawFamily
    form: LawForm
    amplitude: float
    amplitude_sd: float
    numbers: tuple[float, ...]  # of the family
    sds: tuple[float, ...]  # standard deviations of `numbers`

    @property
    def values(self) -> dict[str, float]:
        """All parameters by name."""
        names = ("a", *self.family.numbers)
        return dict(zip(names, (self.amplitude, *self.numbers), strict=True))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LawCurve:
    """Smooth function of a variable with its 95 % band, and the readings."""

    at: Array  # (n,) values of the variable
    mean: Array
    low: Array
    high: Array
    law: Array  # (n,) or empty
    points: Array  # (m,) values of the variable at readings
    shares: Array  # (m,) residuals of readings, as shares of the form's weight


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FoundDependence:
    """Dependence of an unnamed effect."""

    variable: Variable
    form: LawForm
    probability: float  # of this variable among all candidates
    candidates: int  # pairs of variable and form
    law: Law | None  # None if no law closes enough of the gap
    closed: float  # share of the held-out gap closed by laws, in cross-validation
    curve: LawCurve
    radius_m: float  # R of the rotors

    @property
    def phrase(self) -> str:
        """Variable and location, within a sentence."""
        return f"{self.variable.phrase}{self.form.phrase}"

    @property
    def formula(self) -> str:
        """The law in plain text; empty without one."""
        if self.law is None:
            return ""
        return self.form.formula.format(f=self.law.family.formula.format(u=self.variable.symbol))

    @property
    def text(self) -> str:
        """Variable and share of the gap closed by the law, as the end of a sentence."""
        if self.law is None:
            return f"depends on {self.phrase}"
        share = f"{100.0 * self.closed:.0f} % of the held-out gap"
        return f"depends on {self.phrase}; closes {share} as {self.formula}"
