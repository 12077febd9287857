"""Fraction of a rotor disc over a half plane or a rectangle: exact areas.

A tilted disc projects to an ellipse; the difference (1.5 % of the area at 10 degrees) is ignored.
Roots are of (1 - u)(1 + u), not 1 - u^2, for full precision of a disc that just touches the edge.
"""

from __future__ import annotations

import numpy as np

from benchtool.physics.expression import Quantity, expression


@expression
def half_plane_coverage(inside_m: Quantity, radius_m: Quantity) -> Quantity:
    """Return the covered fraction of a disc whose centre is `inside_m` inside a straight edge.

    The area is R^2 (pi - arccos(s/R)) + s sqrt(R^2 - s^2), s clipped to -R to R.
    """
    u = np.minimum(np.maximum(inside_m / radius_m, -1.0), 1.0)
    return 1.0 + (u * np.sqrt((1.0 - u) * (1.0 + u)) - np.arccos(u)) / np.pi


@expression
def half_disc_integral(u: Quantity) -> Quantity:
    """Return the integral of sqrt(1 - t^2) from 0 to u, for -1 <= u <= 1."""
    return 0.5 * (u * np.sqrt((1.0 - u) * (1.0 + u)) + np.arcsin(u))


@expression
def corner_integral(u: Quantity, v: Quantity) -> Quantity:
    """Return the integral over t from 0 to u of v clipped to the unit disc; |u| and |v| up to 1.

    The clipped ordinate is v for |t| <= c = sqrt(1 - v^2), else the edge of the disc. The integral
    is v clip(u, -c, c) plus the half disc beyond c with the sign of v; odd in u and v.
    """
    c = np.sqrt((1.0 - v) * (1.0 + v))
    beyond = half_disc_integral(np.maximum(u, c)) + half_disc_integral(np.minimum(u, -c))
    return v * np.minimum(np.maximum(u, -c), c) + np.sign(np.real(v)) * beyond


@expression
def rectangle_coverage(
    x_m: Quantity,
    y_m: Quantity,
    radius_m: Quantity,
    x1_m: Quantity,
    x2_m: Quantity,
    y1_m: Quantity,
    y2_m: Quantity,
) -> Quantity:
    """Return the covered fraction of a disc centred at (x, y) over [x1, x2] x [y1, y2].

    Sides may be infinite. The four corner integrals are exact; verified with the half-plane
    formula, the corner formula of the circle and Monte Carlo.
    """
    u1 = np.minimum(np.maximum((x1_m - x_m) / radius_m, -1.0), 1.0)
    u2 = np.minimum(np.maximum((x2_m - x_m) / radius_m, -1.0), 1.0)
    v1 = np.minimum(np.maximum((y1_m - y_m) / radius_m, -1.0), 1.0)
    v2 = np.minimum(np.maximum((y2_m - y_m) / radius_m, -1.0), 1.0)
    area = (
        corner_integral(u2, v2)
        - corner_integral(u1, v2)
        - corner_integral(u2, v1)
        + corner_integral(u1, v1)
    )
    return np.minimum(np.maximum(area / np.pi, 0.0), 1.0)
