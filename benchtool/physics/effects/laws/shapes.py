"""Shapes that a law may have in one variable: functions of numbers that hooks may call."""

from __future__ import annotations

import numpy as np

from benchtool.physics.expression import Quantity, expression


@expression
def same(u: Quantity) -> Quantity:
    """Return u itself."""
    return u


@expression
def line(u: Quantity, at: Quantity, width: Quantity) -> Quantity:
    """Return how far u is from `at`, in widths."""
    return (u - at) / width


@expression
def power(u: Quantity, exponent: Quantity) -> Quantity:
    """Return u to a power, for u above 0; nearer to 0 than 0.001 it stays."""
    return np.exp(exponent * np.log(np.maximum(u, 1e-3)))


@expression
def signed_power(u: Quantity, exponent: Quantity) -> Quantity:
    """Return |u| to a power with the sign of u, rounded within 0.001 of 0."""
    return u * np.exp(0.5 * (exponent - 1.0) * np.log(u * u + 1e-6))


@expression
def power_instead(u: Quantity, exponent: Quantity, less: Quantity) -> Quantity:
    """Return u^exponent - less / u^2: a law beside one that goes as 1 / u^2 and is too large."""
    u = np.maximum(u, 1e-3)
    return np.exp(exponent * np.log(u)) - less / (u * u)


@expression
def rational_instead(u: Quantity, width: Quantity, less: Quantity) -> Quantity:
    """Return 1 / (1 + (u / width)^2) - less / u^2."""
    x, u = u / width, np.maximum(u, 1e-3)
    return 1.0 / (1.0 + x * x) - less / (u * u)


@expression
def approach_instead(u: Quantity, length: Quantity, less: Quantity) -> Quantity:
    """Return exp(-u / length) - less / u^2."""
    u = np.maximum(u, 1e-3)
    return np.exp(-u / length) - less / (u * u)


@expression
def step(u: Quantity, at: Quantity, width: Quantity) -> Quantity:
    """Return what goes from 0 to 1 about `at`, over a few widths."""
    return 0.5 + 0.5 * np.tanh(0.5 * (u - at) / width)


@expression
def saturation(u: Quantity, at: Quantity, width: Quantity) -> Quantity:
    """Return by how much u is above `at`, the corner rounded over a few widths."""
    x = (u - at) / width
    return width * (np.maximum(x, 0.0) + np.log1p(np.exp(-np.sqrt(x * x))))


@expression
def resonance(u: Quantity, at: Quantity, width: Quantity) -> Quantity:
    """Return 1 / (1 + ((u - at) / width)^2)."""
    x = (u - at) / width
    return 1.0 / (1.0 + x * x)


@expression
def approach(u: Quantity, length: Quantity) -> Quantity:
    """Return what begins with 1 and falls by e over each length, for u above 0."""
    return np.exp(-np.maximum(u, 0.0) / length)
