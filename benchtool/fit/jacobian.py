"""Derivatives of a prediction: exact by a complex step, central differences where it must be.

f(x + ih) has imaginary part h f'(x) with no difference taken, so h may be so small that nothing
but rounding of f itself is left (Squire and Trapp, SIAM Review 40, 1998, p. 110).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Way = Literal["complex_step", "central_differences"]

STEP = 1e-25
"""Complex step relative to the value: its square vanishes beside one."""

DIFFERENCE = float(np.cbrt(np.finfo(float).eps))
"""Relative step of a central difference that balances truncation and rounding."""

AGREEMENT = 1e-3
"""The two ways may differ by this part of a column's largest entry; errors of a function that is
not complex-safe are of order one."""


def complex_step(predict: Callable[[Any], Any], values: Array, m: int) -> Array:
    """Return d prediction / d values (m, n) in one vectorised call."""
    n = len(values)
    h = STEP * np.where(values == 0.0, 1.0, np.abs(values))
    moved = np.empty((n, n, 1), complex)
    moved[:] = values[:, None, None]
    moved[np.arange(n), np.arange(n), 0] += 1j * h
    moved_prediction = np.broadcast_to(predict(moved), (n, m))
    return np.ascontiguousarray((np.imag(moved_prediction) / h[:, None]).T)


def central_differences(
    predict: Callable[[Any], Any],
    values: Array,
    m: int,
    lower: Array,
    upper: Array,
) -> Array:
    """Return d prediction / d values (m, n) in one vectorised call, steps kept in bounds."""
    n = len(values)
    h = DIFFERENCE * np.where(values == 0.0, 1.0, np.abs(values))
    above, below = np.minimum(values + h, upper), np.maximum(values - h, lower)
    moved = np.empty((n, 2 * n, 1))
    moved[:] = values[:, None, None]
    each = np.arange(n)
    moved[each, each, 0] = above
    moved[each, n + each, 0] = below
    both = np.broadcast_to(np.asarray(predict(moved), float), (2 * n, m))
    return np.ascontiguousarray(((both[:n] - both[n:]) / (above - below)[:, None]).T)


def way_for(
    predict: Callable[[Any], Any], values: Array, m: int, lower: Array, upper: Array
) -> Way:
    """Return which way is right for a function, by comparing both once at `values`."""
    plain = central_differences(predict, values, m, lower, upper)
    try:
        exact = complex_step(predict, values, m)
    except (TypeError, ValueError):
        return "central_differences"
    size = np.maximum(
        np.abs(plain).max(axis=0, initial=0.0), np.abs(exact).max(axis=0, initial=0.0)
    )
    floor = 1e-9 * np.abs(np.asarray(predict(values))).max(initial=0.0)
    floor = floor / np.where(values == 0.0, 1.0, np.abs(values))
    close = np.abs(exact - plain).max(axis=0, initial=0.0) <= AGREEMENT * size + floor
    return "complex_step" if bool(np.all(close | ~np.isfinite(size))) else "central_differences"
