"""A C header with the thrust near a surface, for firmware: float, no heap, no globals.

The thrust factor of any law is written as polynomials of degree 7 over pieces of z_min/z, which is
0 far away and 1 at the least distance; pieces are halved until each holds the model.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import chebyshev

from benchtool.core.array_type import Array
from benchtool.core.errors import InputError
from benchtool.export.render import render
from benchtool.export.vehicle import Vehicle

DEGREE = 7
TOLERANCE = 1e-7  # relative error of a piece: float's own rounding adds a few times 6e-8
MAX_PIECES = 128  # more are a law that no polynomial follows: 128 are 4 kB; assumed


def split_intervals(vehicle: Vehicle) -> tuple[Array, Array]:
    """Return ends (n + 1,) of the pieces in z_min/z, and their coefficients (n, DEGREE + 1).

    Coefficients are of powers of x, -1 to 1 over a piece.

    Raises:
        InputError: the law has more pieces than `MAX_PIECES`.
    """
    nearest_m = vehicle.nearest_z_m
    nodes = np.cos(np.pi * (np.arange(DEGREE + 1) + 0.5) / (DEGREE + 1))
    check = np.linspace(-1.0, 1.0, 33)
    ends, found = [0.0], []
    left = [(0.0, 1.0)]
    while left:
        low, high = left.pop()
        middle, half = 0.5 * (low + high), 0.5 * (high - low)

        def factor(x: Array, middle: float = middle, half: float = half) -> Array:
            s = np.maximum(middle + half * x, 1e-9)
            return vehicle.factor(nearest_m / s)

        series = chebyshev.chebfit(nodes, factor(nodes), DEGREE)
        truth = factor(check)
        if np.abs(chebyshev.chebval(check, series) / truth - 1.0).max() < TOLERANCE:
            ends.append(high)
            found.append(chebyshev.cheb2poly(series))
            continue
        if len(found) + len(left) + 2 > MAX_PIECES:
            raise InputError(
                f"model {vehicle.model.name!r}: its law of thrust against distance has corners "
                f"that {MAX_PIECES} polynomials do not follow; export a model with a smooth law"
            )
        left += [(middle, high), (low, middle)]
    width = DEGREE + 1
    return np.array(ends), np.array([np.pad(one, (0, width - len(one))) for one in found])


def c_header(vehicle: Vehicle) -> str:
    """Return the header; its names begin with the rig's."""
    ends, coefficients = split_intervals(vehicle)
    values = {"ends": ends, "coefficients": coefficients, "degree": DEGREE}
    return render("c_header", vehicle, **values)
