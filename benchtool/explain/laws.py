"""Laws of an unnamed effect: variables, forms, families with grids of shapes, drafted effect."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from importlib.resources import files
from json import dumps
from textwrap import fill
from typing import Any, Literal

import numpy as np

from benchtool import __version__
from benchtool.core.units import Array
from benchtool.physics.effects.effect import BenchKind, Subsystem
from benchtool.physics.effects.laws import shapes

Scale = Literal["positive", "time", "signed", "side", "distance"]
# Of a variable: above 0; time since a start; with both signs; one of two sides; a distance over
# which all effects vanish

DISTANCES: tuple[Scale, ...] = ("distance",)
NUMBERS: tuple[Scale, ...] = ("positive", "time", "signed")


@dataclass(frozen=True, slots=True)
class LawFamily:
    """Family of laws f(u)."""

    name: str
    function: Callable[..., Any]  # of `effects.laws.shapes`, called with u and the numbers
    formula: str  # of a f(u), with {u} for the variable
    numbers: tuple[str, ...]  # names of the shape parameters
    grid: Callable[[Array], Array]  # of numbers (n, n_shapes) for values (m,) of the variable
    scales: tuple[Scale, ...]  # of suitable variables

    def __call__(self, u: Array, numbers: Sequence[float] | Array) -> Array:
        """Return the law's values (m,) or (m, n_shapes), for numbers (n,) or (n, n_shapes)."""
        numbers = np.asarray(numbers, float)
        values: Array = self.function(u[:, None] if numbers.ndim > 1 else u, *numbers)
        return values


POSITIONS = np.linspace(0.04, 0.96, 16)  # of a step or peak, in shares of the variable's range
REPLACED = np.array([0.0, 0.06, 0.12, 0.25, 0.4, 0.6, 0.8, 1.0])  # shares of the model's law
WIDTHS = np.array([[0.2, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0]])
EXPONENTS = np.array([[-4.0, -3.0, -2.0, -1.5, -1.0, -0.5, 0.5, 1.5, 2.0, 3.0, 4.0]])
ODD_EXPONENTS = np.array([[0.3, 0.5, 1.5, 2.0, 2.5, 3.0]])
LENGTHS = np.array([[0.02, 0.05, 0.1, 0.2, 0.4, 0.8]])  # shares of the variable's range


def _middle(u: Array) -> Array:
    return np.array([[float(np.mean(u))], [max(float(np.std(u)), 1e-9)]])


def _positions(*widths: float) -> Callable[[Array], Array]:
    """Return a grid of positions over the range, each with widths as shares of the range."""

    def grid(u: Array) -> Array:
        low, high = float(u.min()), float(u.max())
        at = low + POSITIONS * (high - low)
        pairs = np.meshgrid(at, (high - low) * np.array(widths), indexing="ij")
        return np.array([axis.ravel() for axis in pairs])

    return grid


def _fixed(numbers: Array) -> Callable[[Array], Array]:
    """Return a grid of shapes that are equal for all variables."""
    return lambda u: numbers


def _replacing(numbers: Array) -> Callable[[Array], Array]:
    """Return a grid of shapes, each with shares of 1 / u^2 that they replace."""
    pairs = np.meshgrid(numbers[0], REPLACED, indexing="ij")
    return _fixed(np.array([axis.ravel() for axis in pairs]))


FAMILIES = (  # simplest first
    LawFamily("same", shapes.same, "a {u}", (), _fixed(np.empty((0, 1))), ("side",)),
    LawFamily("line", shapes.line, "a ({u} - at) / width", ("at", "width"), _middle, NUMBERS),
    LawFamily(
        "power", shapes.power, "a ({u})^exponent", ("exponent",), _fixed(EXPONENTS), ("positive",)
    ),
    LawFamily(
        "signed_power", shapes.signed_power, "a {u} |{u}|^(exponent - 1)", ("exponent",),
        _fixed(ODD_EXPONENTS), ("signed",),
    ),
    LawFamily(
        "approach", shapes.approach, "a exp(-({u}) / length)", ("length",),
        lambda u: np.ptp(u) * LENGTHS, ("positive", "time"),
    ),
    LawFamily(
        "power_instead", shapes.power_instead, "a (({u})^exponent - less / ({u})^2)",
        ("exponent", "less"), _replacing(EXPONENTS), DISTANCES,
    ),
    LawFamily(
        "rational_instead", shapes.rational_instead,
        "a (1 / (1 + ({u} / width)^2) - less / ({u})^2)", ("width", "less"),
        _replacing(WIDTHS), DISTANCES,
    ),
    LawFamily(
        "approach_instead", shapes.approach_instead, "a (exp(-({u}) / length) - less / ({u})^2)",
        ("length", "less"), _replacing(WIDTHS), DISTANCES,
    ),
    LawFamily(
        "step", shapes.step, "a / (1 + exp(-({u} - at) / width))", ("at", "width"),
        _positions(0.01, 0.03), NUMBERS,
    ),
    LawFamily(
        "saturation", shapes.saturation, "a max({u} - at, 0)", ("at", "width"),
        _positions(0.02, 0.06), NUMBERS,
    ),
    LawFamily(
        "resonance", shapes.resonance, "a / (1 + (({u} - at) / width)^2)", ("at", "width"),
        _positions(0.05, 0.1, 0.2, 0.4), NUMBERS,
    ),
)  # fmt: skip

Hook = Literal["factor", "thrust_reading", "torque", "gyro_reading"]  # hooks of drafted effects
DISTANCE = "flow.height_m[i] / p.radius_m"  # plate distance over radius, in the code of a hook
NEAR = f"flow.coverage[i] / (1.0 + ({DISTANCE}) * ({DISTANCE}))"  # weight of a law near the plate


@dataclass(frozen=True, slots=True, eq=False)
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
    amplitude: float
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


DRAFT_NAME = "found_effect"  # name of a drafted effect and of its file
LAW_TOLERANCE = 0.1  # min tolerance as a share of the law: no law is known better
MAX_SHAPE_SD = 0.3  # of the prior: of a position in widths, of others in shares of the value


HOOKS: dict[Hook, tuple[str, Subsystem]] = {  # what a hook returns, and the stage of its effect
    "factor": ("a factor of the thrust", "rpm_to_thrust"),
    "thrust_reading": ("the reading with the law added: N", "sensor"),
    "torque": ("a torque about the hinge, positive nose down: N m", "hinge"),
    "gyro_reading": ("the reading with the law added: rad/s", "sensor"),
}


def draft_effect(dependence: FoundDependence) -> str:
    """Return the text of an effect file for a dependence with a law."""
    law, variable, form = dependence.law, dependence.variable, dependence.form
    assert law is not None
    changes = form.weights * law.family(variable.values, law.numbers)
    tolerance = form.tolerance / float(np.abs(changes).max())
    tolerance = max(tolerance, LAW_TOLERANCE * abs(law.amplitude))
    bound = max(20.0 * abs(law.amplitude), 10.0 * tolerance)
    lines = [
        _number(
            "a", "1", law.amplitude, "size of the law", "neutral=0",
            f"within=({-bound:.6g}, {bound:.6g})", f"tolerance={tolerance:.3g}",
        )
    ]  # fmt: skip
    for name, value, sd in zip(law.family.numbers, law.numbers, law.sds, strict=True):
        scale = law.values.get("width", 0.5) if name == "at" else abs(value)
        prior_sd = max(min(sd, MAX_SHAPE_SD * scale), 1e-4)
        prior = f'prior=Prior("normal", {value:.6g}, {prior_sd:.3g}, "benchtool explain")'
        within = f"within=({0.1 * value:.6g}, {10.0 * value:.6g})"
        options = (within, prior) if name in ("width", "length") else (prior,)
        lines.append(_number(name, "1", value, "shape of the law", *options))
    code = form.code + variable.code
    if "p.reference" in code:
        lines.append(_number("reference", variable.unit, variable.reference, "reference"))
    if "p.radius_m" in code:
        lines.append(_number("radius_m", "m", dependence.radius_m, "radius R of the rotors"))
    if "p.typical" in code:
        lines.append(_number("typical", form.unit, float(form.weights[0]), "unit of a"))
    numbers = ", ".join(f"p.{name}" for name in law.family.numbers)
    shape = f"{law.family.name}({variable.code}, {numbers})"
    assert form.hook
    returns, subsystem = HOOKS[form.hook]
    values = ", ".join(f"{name} = {value:.4g}" for name, value in law.values.items())
    if variable.unit != "1":
        values += f"; reference: {variable.reference:.4g} {variable.unit}"
    functions = {law.family.name} | ({"power"} if "power(" in form.code else set())
    description = f"Effect that depends on {dependence.phrase}; its cause is unknown."
    template = (files("benchtool.explain") / "found_effect.txt").read_text("utf-8")
    return template.format(
        name=DRAFT_NAME,
        version=__version__,
        text=fill(f"It {dependence.text}. Values: {values}.", 99),
        functions=", ".join(sorted(functions)),
        hook=form.hook,
        argument=", reading: Quantity" if "reading" in form.hook else "",
        returns=returns,
        code=form.code.format(f=shape),
        description=dumps(description),
        subsystem=subsystem,
        bench=form.bench,
        formula=dumps(dependence.formula),
        numbers="\n".join(lines),
        shows=dumps(f"where this differs: {dependence.phrase}"),
    )


def _number(name: str, unit: str, value: float, description: str, *options: str) -> str:
    """Return the source text of a parameter in an effect file."""
    parts = [dumps(name), dumps(unit), f"{value:.6g}", dumps(description), *options]
    parts.append('source="benchtool explain"')
    lines = "".join(f"            {part},\n" for part in parts)
    return f"        number(\n{lines}        ),"
