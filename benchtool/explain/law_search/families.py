"""Families of laws in one variable, with the shapes of each that are tried."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from benchtool.core.array_type import Array
from benchtool.physics.effects.laws import shapes

Scale = Literal["positive", "time", "signed", "side", "distance"]
"""Of a variable: above 0, above 0 and counted from a beginning, on both sides of 0,
one of two sides, or a distance over which everything falls off to nothing."""


DISTANCE: tuple[Scale, ...] = ("distance",)
NUMBERS: tuple[Scale, ...] = ("positive", "time", "signed")


@dataclass(frozen=True, slots=True)
class LawFamily:
    """Describe a family of laws f(u).

    Attributes:
        function: of `effects.laws.shapes`, called with u and the numbers in order.
        formula: of a f(u), with {u} for the variable.
        grid: numbers (n, n_shapes) to try for values (m,) of the variable.
        scales: of variables that it suits.
    """

    name: str
    function: Callable[..., Any]
    formula: str
    numbers: tuple[str, ...]
    grid: Callable[[Array], Array]
    scales: tuple[Scale, ...]

    def __call__(self, u: Array, numbers: Sequence[float] | Array) -> Array:
        """Return the law's values (m,) or (m, n_shapes), for numbers (n,) or (n, n_shapes)."""
        numbers = np.asarray(numbers, float)
        values: Array = self.function(u[:, None], *numbers) if numbers.ndim > 1 else (
            self.function(u, *numbers)
        )  # fmt: skip
        return values


PLACES = np.linspace(0.04, 0.96, 16)  # quantiles of the values at which a law may have its place


def _none(u: Array) -> Array:
    return np.empty((0, 1))


LESS = np.array([0.0, 0.06, 0.12, 0.25, 0.4, 0.6, 0.8, 1.0])  # parts of the model's own law


def _widths(u: Array) -> Array:
    return np.array([[0.2, 0.35, 0.5, 0.7, 1.0, 1.4, 2.0]])


def _middle(u: Array) -> Array:
    return np.array([[float(np.mean(u))], [max(float(np.std(u)), 1e-9)]])


def _placed(*widths: float) -> Callable[[Array], Array]:
    """Return places over the range, each with widths as parts of the range."""

    def grid(u: Array) -> Array:
        low, high = float(u.min()), float(u.max())
        at = low + PLACES * (high - low)
        pairs = np.meshgrid(at, (high - low) * np.array(widths), indexing="ij")
        return np.array([axis.ravel() for axis in pairs])

    return grid


def _exponents(u: Array) -> Array:
    return np.array([[-4.0, -3.0, -2.0, -1.5, -1.0, -0.5, 0.5, 1.5, 2.0, 3.0, 4.0]])


def _odd(u: Array) -> Array:
    return np.array([[0.3, 0.5, 1.5, 2.0, 2.5, 3.0]])


def _instead(shapes_tried: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """Return shapes with how much of 1 / u^2 they replace."""

    def grid(u: Array) -> Array:
        pairs = np.meshgrid(shapes_tried(u)[0], LESS, indexing="ij")
        return np.array([axis.ravel() for axis in pairs])

    return grid


def _lengths(u: Array) -> Array:
    reach = float(u.max() - u.min())
    return np.array([reach * np.array([0.02, 0.05, 0.1, 0.2, 0.4, 0.8])])


FAMILIES = (
    LawFamily("same", shapes.same, "a {u}", (), _none, ("side",)),
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
        ("exponent", "less"), _instead(_exponents), DISTANCE,
    ),
    LawFamily(
        "rational_instead", shapes.rational_instead,
        "a (1 / (1 + ({u} / width)^2) - less / ({u})^2)", ("width", "less"),
        _instead(_widths), DISTANCE,
    ),
    LawFamily(
        "approach_instead", shapes.approach_instead, "a (exp(-({u}) / length) - less / ({u})^2)",
        ("length", "less"), _instead(_widths), DISTANCE,
    ),
    LawFamily(
        "step", shapes.step, "a / (1 + exp(-({u} - at) / width))", ("at", "width"),
        _placed(0.01, 0.03), NUMBERS,
    ),
    LawFamily(
        "saturation", shapes.saturation, "a max({u} - at, 0)", ("at", "width"),
        _placed(0.02, 0.06), NUMBERS,
    ),
    LawFamily(
        "resonance", shapes.resonance, "a / (1 + (({u} - at) / width)^2)", ("at", "width"),
        _placed(0.05, 0.1, 0.2, 0.4), NUMBERS,
    ),
)  # fmt: skip
"""The shortest first."""
