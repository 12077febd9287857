"""Sine and cosine as polynomials: several lanes at once need functions without a library call."""

from __future__ import annotations

from benchtool.physics.expression import Quantity, expression


@expression
def sine(angle_rad: Quantity) -> Quantity:
    """Return the sine, right to 5e-16 up to a quarter turn: Taylor's series to order 19."""
    v = angle_rad * angle_rad
    high = 1.0 / 6227020800.0 + v * (
        -1.0 / 1307674368000.0 + v * (1.0 / 355687428096000.0 - v * (1.0 / 121645100408832000.0))
    )
    low = 1.0 / 120.0 + v * (
        -1.0 / 5040.0 + v * (1.0 / 362880.0 - v * (1.0 / 39916800.0 - v * high))
    )
    return angle_rad * (1.0 - v * (1.0 / 6.0 - v * low))


@expression
def cosine(angle_rad: Quantity) -> Quantity:
    """Return the cosine, right to 5e-16 up to a quarter turn: Taylor's series to order 20."""
    v = angle_rad * angle_rad
    high = 1.0 / 479001600.0 + v * (
        -1.0 / 87178291200.0
        + v
        * (
            1.0 / 20922789888000.0
            + v * (-1.0 / 6402373705728000.0 + v * (1.0 / 2432902008176640000.0))
        )
    )
    low = 1.0 / 24.0 + v * (-1.0 / 720.0 + v * (1.0 / 40320.0 - v * (1.0 / 3628800.0 - v * high)))
    return 1.0 - v * (0.5 - v * low)
