"""Functions of one variable for laws of user-defined effects."""

from __future__ import annotations

import numpy as np

from benchtool.physics.expression import Quantity, expression


@expression
def same(u: Quantity) -> Quantity:
    """Return u itself."""
    return u


@expression
def line(u: Quantity, at: Quantity, width: Quantity) -> Quantity:
    """Return (u - at) / width."""
    return (u - at) / width


@expression
def power(u: Quantity, exponent: Quantity) -> Quantity:
    """Return u^exponent, u clipped to at least 0.001."""
    return np.exp(exponent * np.log(np.maximum(u, 1e-3)))


@expression
def signed_power(u: Quantity, exponent: Quantity) -> Quantity:
    """Return sign(u) |u|^exponent, smoothed within 0.001 of 0."""
    return u * np.exp(0.5 * (exponent - 1.0) * np.log(u * u + 1e-6))


@expression
def power_instead(u: Quantity, exponent: Quantity, less: Quantity) -> Quantity:
    """Return u^exponent - less / u^2, to replace a share `less` of a term 1 / u^2."""
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
    """Return a smooth step from 0 to 1 at `at`, over a few widths (logistic function)."""
    return 0.5 + 0.5 * np.tanh(0.5 * (u - at) / width)


@expression
def saturation(u: Quantity, at: Quantity, width: Quantity) -> Quantity:
    """Return max(u - at, 0) with the corner rounded over a few widths (softplus)."""
    x = (u - at) / width
    return width * (np.maximum(x, 0.0) + np.log1p(np.exp(-np.sqrt(x * x))))


@expression
def resonance(u: Quantity, at: Quantity, width: Quantity) -> Quantity:
    """Return 1 / (1 + ((u - at) / width)^2)."""
    x = (u - at) / width
    return 1.0 / (1.0 + x * x)


@expression
def approach(u: Quantity, length: Quantity) -> Quantity:
    """Return exp(-u / length), u clipped to at least 0."""
    return np.exp(-np.maximum(u, 0.0) / length)
