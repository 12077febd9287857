"""C header with the thrust near a surface, for firmware: float, no heap, no globals.

The thrust factor is a piecewise polynomial of degree 7 in z_min/z (0 far away, 1 at the minimum
distance); intervals are halved until the error is within tolerance.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev

from benchtool.core.errors import InputError
from benchtool.core.units import Array
from benchtool.export.vehicle import Vehicle

DEGREE = 7
TOLERANCE = 1e-7  # relative error of an interval; float rounding adds a few times 6e-8
MAX_INTERVALS = 128  # 4 kB; assumed


def split_intervals(vehicle: Vehicle) -> tuple[Array, Array]:
    """Return interval ends (n + 1,) in z_min/z, and coefficients (n, DEGREE + 1).

    Coefficients are of powers of x, -1 to 1 over an interval.

    Raises:
        InputError: the law needs more than `MAX_INTERVALS`.
    """
    nearest_m = vehicle.nearest_z_m
    nodes = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
    check = np.linspace(-1.0, 1.0, 33)
    ends, coefficients = [0.0], []
    pending = [(0.0, 1.0)]
    while pending:
        low, high = pending.pop()
        middle, half = 0.5 * (low + high), 0.5 * (high - low)

        def factor(x: Array, middle: float = middle, half: float = half) -> Array:
            s = np.maximum(middle + half * x, 1e-9)
            return vehicle.factor(nearest_m / s)

        series = chebyshev.chebfit(nodes, factor(nodes), DEGREE)
        truth = factor(check)
        if np.abs(chebyshev.chebval(check, series) / truth - 1.0).max() < TOLERANCE:
            ends.append(high)
            coefficients.append(chebyshev.cheb2poly(series))
            continue
        if len(coefficients) + len(pending) + 2 > MAX_INTERVALS:
            raise InputError(
                f"model {vehicle.model.name!r}: {MAX_INTERVALS} polynomials do not fit its law of "
                f"thrust against distance; export a model with a smooth law"
            )
        pending += [(middle, high), (low, middle)]
    width = DEGREE + 1
    return np.array(ends), np.array([np.pad(c, (0, width - len(c))) for c in coefficients])


def c_header(vehicle: Vehicle) -> dict[str, object]:
    """Return the values of the header."""
    ends, coefficients = split_intervals(vehicle)
    return {"ends": ends, "coefficients": coefficients, "degree": DEGREE}
