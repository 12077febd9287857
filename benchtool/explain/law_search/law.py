"""Dependence of an unnamed effect on a variable, with its law."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from benchtool.core.array_type import Array
from benchtool.explain.law_search.families import LawFamily, Scale
from benchtool.physics.effects.effect import BenchKind

Hook = Literal["factor", "thrust_reading", "torque", "gyro_reading"]  # hooks of drafted effects
DISTANCE = "flow.height_m[i] / p.radius_m"  # the plate's distance as a hook sees it


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Variable:
    """Describe what a law may depend on, as a group without a unit.

    Attributes:
        values: (m,) of each reading.
        code: the same as a hook sees it, with `p.reference` for the reference.
        reference: what the quantity is divided by, in `unit`.
        blocks: whether readings of one value are one, and others have nothing in common with it.
    """

    phrase: str  # what it is, as a sentence says it
    symbol: str  # as a formula has it
    values: Array
    code: str = ""
    reference: float = 1.0
    unit: str = "1"
    scale: Scale = "positive"
    forms: tuple[str, ...] = ("factor", "near", "nearer", "reading")  # that suit it
    blocks: bool = False


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LawForm:
    """Target of a law: a reading, torque or thrust changes by a f(u) times weights (m,).

    Attributes:
        formula: with {f} for a f(u).
        code: of the hook's result, with {f} for f(u), `p.typical` for what a counts in.
        matters: departure of the weighted law that does not matter.
        unit: of `weights`, where a is counted in them.
        centred: whether a law's mean is left out: a law of the distance or the thrust coefficient
            takes it up.
        phrase: where it acts, as a sentence says it.
        share_of: what a law's values are a part of, as an axis says it.
    """

    name: str
    hook: Hook | Literal[""]
    weights: Array
    formula: str
    code: str
    matters: float
    bench: BenchKind = "sweep"
    unit: str = "N"
    centred: bool = False
    phrase: str = ""
    share_of: str = "thrust"

    def seen(self, variable: Variable) -> Array:
        """Return the values of a variable over the readings that the form changes."""
        values: Array = variable.values[np.abs(self.weights) > 0.02 * np.abs(self.weights).max()]
        return values


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Law:
    """Law a f(u) with its numbers."""

    family: LawFamily
    form: LawForm
    amplitude: float
    amplitude_sd: float
    numbers: tuple[float, ...]  # of the family
    sds: tuple[float, ...]  # their standard deviations

    @property
    def values(self) -> dict[str, float]:
        """All numbers by name."""
        names = ("a", *self.family.numbers)
        return dict(zip(names, (self.amplitude, *self.numbers), strict=True))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class LawCurve:
    """Curve with its band over a variable, and the readings behind it.

    Attributes:
        at: (n,) places; `mean`, `low` and `high` (n,) of a smooth function there, 95 %.
        law: (n,) the law there; empty without one.
        points, shares: (m,) places of readings and what they miss, as parts of the form's weight.
    """

    at: Array
    mean: Array
    low: Array
    high: Array
    law: Array
    points: Array
    shares: Array


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FoundDependence:
    """Dependence of an unnamed effect.

    Attributes:
        probability: that it is this variable, of all that were weighed.
        candidates: how many pairs of a variable and a form were weighed.
        law: None where no law closes enough of the gap.
        closed: share of the held-out gap that laws close which were chosen without it.
    """

    variable: Variable
    form: LawForm
    probability: float
    candidates: int
    law: Law | None
    closed: float
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
        """Variable, and share of the gap that the law closes, as the end of a sentence."""
        if self.law is None:
            return f"depends on {self.phrase}"
        share = f"{100.0 * self.closed:.0f} % of the held-out gap"
        return f"depends on {self.phrase}; closes {share} as {self.formula}"
