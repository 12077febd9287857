"""Families of laws in one variable, with grids of shapes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from benchtool.core.units import Array
from benchtool.physics.effects.laws import shapes

Scale = Literal["positive", "time", "signed", "side", "distance"]
# Of a variable: above 0; time since a start; with both signs; one of two sides; a distance over
# which all effects vanish

DISTANCE: tuple[Scale, ...] = ("distance",)
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


def _no_shapes(u: Array) -> Array:
    return np.empty((0, 1))


REPLACED = np.array([0.0, 0.06, 0.12, 0.25, 0.4, 0.6, 0.8, 1.0])  # shares of the model's law


def _widths(u: Array) -> Array:
    return np.array([[0.2, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0]])


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


def _exponents(u: Array) -> Array:
    return np.array([[-4.0, -3.0, -2.0, -1.5, -1.0, -0.5, 0.5, 1.5, 2.0, 3.0, 4.0]])


def _odd(u: Array) -> Array:
    return np.array([[0.3, 0.5, 1.5, 2.0, 2.5, 3.0]])


def _replacing(shape_grid: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """Return a grid of shapes, each with shares of 1 / u^2 that they replace."""

    def grid(u: Array) -> Array:
        pairs = np.meshgrid(shape_grid(u)[0], REPLACED, indexing="ij")
        return np.array([axis.ravel() for axis in pairs])

    return grid


def _lengths(u: Array) -> Array:
    width = float(u.max() - u.min())
    return np.array([width * np.array([0.02, 0.05, 0.1, 0.2, 0.4, 0.8])])


FAMILIES = (  # simplest first
    LawFamily("same", shapes.same, "a {u}", (), _no_shapes, ("side",)),
    LawFamily("line", shapes.line, "a ({u} - at) / width", ("at", "width"), _middle, NUMBERS),
    LawFamily("power", shapes.power, "a ({u})^exponent", ("exponent",), _exponents, ("positive",)),
    LawFamily(
        "signed_power", shapes.signed_power, "a {u} |{u}|^(exponent - 1)", ("exponent",), _odd,
        ("signed",),
    ),
    LawFamily(
        "approach", shapes.approach, "a exp(-({u}) / length)", ("length",), _lengths,
        ("positive", "time"),
    ),
    LawFamily(
        "power_instead", shapes.power_instead, "a (({u})^exponent - less / ({u})^2)",
        ("exponent", "less"), _replacing(_exponents), DISTANCE,
    ),
    LawFamily(
        "rational_instead", shapes.rational_instead,
        "a (1 / (1 + ({u} / width)^2) - less / ({u})^2)", ("width", "less"),
        _replacing(_widths), DISTANCE,
    ),
    LawFamily(
        "approach_instead", shapes.approach_instead, "a (exp(-({u}) / length) - less / ({u})^2)",
        ("length", "less"), _replacing(_widths), DISTANCE,
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
