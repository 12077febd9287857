"""Flow below a hovering quadrotor, two pictures: sources with images, vortex rings with images.

The first is the model behind eq. (2) to (4): every rotor a point source, mirrored below the ground.
It is irrotational everywhere and cannot show the upflow between the rotors. The second is a
prescribed wake, not a solution: every rotor's slipstream a stack of vortex rings that contracts a
little, with images of opposite sign; it shows jets under the rotors and the fountain between them.
Neither predicts; K_b stays an empirical number.

Lengths are in rotor radii and velocities in induced velocities v_h of hover. Heights are
above ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchtool.core.array import Array

SHEET_OVER_INDUCED = 2.0
"""Strength of a slipstream's vortex sheet over v_h: the jump from still air to the far wake."""

LOWEST = 0.25
"""Height over the ground at which the wake ends, in R: below it would have to turn outward."""

CORE = 0.08
"""Core radius of a ring, in R: half the spacing of the stack; keeps the sheet smooth."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hover:
    """Describe the hover: rotors at (x, y) (n, 2), at a height, all in R."""

    places: Array
    height: float = 2.0

    @classmethod
    def quad(cls, spacing: float = 2.65, height: float = 2.0) -> Hover:
        """Return four rotors on a square of that side (PQUAD: 0.318 m / 0.12 m = 2.65)."""
        s = 0.5 * spacing
        return cls(places=np.array([[s, s], [-s, s], [-s, -s], [s, -s]]), height=height)


def source_velocity(hover: Hover, points: Array) -> Array:
    """Return the velocity (3, ...) of the sources and their images at points (3, ...).

    A rotor emits pi R^2 v into all directions: a source of strength R^2 v / 4, as the paper has it.
    """
    velocity = np.zeros_like(points)
    for x, y in hover.places:
        for z in (hover.height, -hover.height):
            away = points - _column((x, y, z), points.ndim)
            distance = np.sqrt((away * away).sum(axis=0))
            velocity += 0.25 * away / np.maximum(distance, 1e-9) ** 3
    return velocity


def contraction(depth: Array) -> Array:
    """Return the radius of the slipstream at a depth below its rotor, both in R.

    Landgrebe's form from 1 towards 0.87, slower than measured wakes: a slight contraction that
    ends well above the ground. An assumption.
    """
    return np.asarray(0.87 + 0.13 * np.exp(-1.5 * depth))


def complete_elliptic(m: Array) -> tuple[Array, Array]:
    """Return the complete elliptic integrals K(m) and E(m) for 0 <= m < 1.

    By the arithmetic-geometric mean, to rounding: Abramowitz and Stegun, section 17.6.
    """
    a, b = np.ones_like(m), np.sqrt(1.0 - m)
    total, weight = 0.5 * m, 0.5
    for _ in range(8):
        a, b, c = 0.5 * (a + b), np.sqrt(a * b), 0.5 * (a - b)
        weight *= 2.0
        total = total + weight * c * c
    K = 0.5 * np.pi / a
    return K, K * (1.0 - total)


def ring_velocity(radius: Array, height: Array, strength: float, rho: Array, z: Array) -> Array:
    """Return the axial and radial velocity (2, ...) of one vortex ring per unit length.

    Args:
        radius: of the ring.
        height: of the ring.
        strength: circulation; positive blows downward inside.
        rho: distance of the points from the ring's axis (...).
        z: height of the points (...).

    Source: the closed form with complete elliptic integrals (Lamb, Hydrodynamics, section 161),
    with a core added to the distance.
    """
    up = z - height
    far = (radius + rho) ** 2 + up**2 + CORE**2
    near = (radius - rho) ** 2 + up**2 + CORE**2
    m = 4.0 * radius * rho / far
    K, E = complete_elliptic(m)
    factor = strength / (2.0 * np.pi * np.sqrt(far))
    axial = -factor * (K + (radius**2 - rho**2 - up**2 - CORE**2) / near * E)
    safe = np.maximum(rho, 1e-6)
    radial = -factor * up / safe * (-K + (radius**2 + rho**2 + up**2 + CORE**2) / near * E)
    return np.array([axial, np.where(rho < 1e-6, 0.0, radial)])


def vortex_velocity(hover: Hover, points: Array, rings: int = 60) -> Array:
    """Return the velocity (3, ...) of the ring stacks and their images at points (3, ...).

    Args:
        hover: rotors and height.
        points: (3, ...) in R; z above ground.
        rings: of each stack.
    """
    length = hover.height - LOWEST
    depths = (np.arange(rings) + 0.5) * length / rings
    radii = contraction(depths)
    strength = SHEET_OVER_INDUCED * length / rings
    velocity = np.zeros_like(points)
    for x, y in hover.places:
        dx, dy = points[0] - x, points[1] - y
        rho = np.hypot(dx, dy)
        total = np.zeros((2, *rho.shape))
        for depth, radius in zip(depths, radii, strict=True):
            at = hover.height - depth
            total += ring_velocity(radius, at, strength, rho, points[2])
            total += ring_velocity(radius, -at, -strength, rho, points[2])
        safe = np.maximum(rho, 1e-9)
        velocity += np.array([total[1] * dx / safe, total[1] * dy / safe, total[0]])
    return velocity


def _column(place: tuple[float, float, float], ndim: int) -> Array:
    return np.reshape(np.array(place, float), (3,) + (1,) * (ndim - 1))
