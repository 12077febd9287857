"""Flow pictures: the ground, symmetry, far field, one ring by integration, the notes' table."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipe, ellipk

from benchtool.physics.wake_picture import (
    CORE,
    Hover,
    complete_elliptic,
    contraction,
    ring_velocity,
    source_velocity,
    vortex_velocity,
)

HOVER = Hover.quad()
FIELDS = [source_velocity, vortex_velocity]


@pytest.mark.parametrize("field", FIELDS)
def test_nothing_flows_through_the_ground(field, rng: np.random.Generator) -> None:
    points = np.vstack([rng.uniform(-4.0, 4.0, (2, 40)), np.zeros((1, 40))])
    np.testing.assert_allclose(field(HOVER, points)[2], 0.0, atol=1e-12)


@pytest.mark.parametrize("field", FIELDS)
def test_four_quarters_are_alike(field, rng: np.random.Generator) -> None:
    points = rng.uniform([[-3.0], [-3.0], [0.1]], [[3.0], [3.0], [2.5]], (3, 20))
    here = field(HOVER, points)
    mirrored = field(HOVER, points * np.array([[-1.0], [1.0], [1.0]]))
    turned = field(HOVER, np.array([-points[1], points[0], points[2]]))
    np.testing.assert_allclose(mirrored * np.array([[-1.0], [1.0], [1.0]]), here, atol=1e-11)
    np.testing.assert_allclose(np.array([turned[1], -turned[0], turned[2]]), here, atol=1e-11)


@pytest.mark.parametrize(("field", "power"), [(source_velocity, 2.0), (vortex_velocity, 4.0)])
def test_far_away_it_fades(field, power: float) -> None:
    direction = np.array([0.6, 0.48, 0.64])
    speeds = [np.linalg.norm(field(HOVER, (r * direction)[:, None])) for r in (60.0, 120.0)]
    assert np.log2(speeds[0] / speeds[1]) == pytest.approx(power, abs=0.05)


def test_a_ring_agrees_with_biot_and_savart() -> None:
    radius, height, rho, z = 0.9, 1.2, 1.6, 0.7
    angle = (np.arange(4000) + 0.5) * 2.0 * np.pi / 4000
    ring = np.array([radius * np.cos(angle), radius * np.sin(angle), np.full(4000, height)])
    along = np.array([np.sin(angle), -np.cos(angle), np.zeros(4000)]) * radius * np.pi / 2000.0
    away = np.array([[rho], [0.0], [z]]) - ring
    cubed = ((away**2).sum(axis=0) + CORE**2) ** 1.5
    direct = (np.cross(along.T, away.T).T / cubed).sum(axis=1) / (4.0 * np.pi)
    axial, radial = ring_velocity(
        np.array(radius), np.array(height), 1.0, np.array(rho), np.array(z)
    )
    assert axial == pytest.approx(direct[2], rel=0.01)
    assert radial == pytest.approx(direct[0], rel=0.01)
    inside, _ = ring_velocity(np.array(1.0), np.array(0.0), 1.0, np.array(0.0), np.array(0.0))
    assert inside == pytest.approx(-0.5, rel=0.02)  # circulation over the diameter, downward


def test_the_sources_show_no_fountain_and_the_rings_do() -> None:
    heights = np.array([0.25, 0.5, 1.0, 1.5, 1.75, 2.0])
    centre = np.array([0.0 * heights, 0.0 * heights, heights])
    sources = source_velocity(HOVER, centre)[2]
    np.testing.assert_allclose(sources, [-0.014, -0.026, -0.037, -0.013, 0.014, 0.046], atol=6e-4)
    rings = vortex_velocity(HOVER, centre)[2]
    prototype = [0.22, 0.37, 0.46, 0.43, 0.37, 0.28]  # another prescribed wake of the same kind
    np.testing.assert_allclose(rings, prototype, atol=0.08)
    below = np.array([[1.325], [1.325], [1.0]])
    assert -1.4 < vortex_velocity(HOVER, below)[2, 0] < -1.0


def test_the_slipstream_contracts_and_stays_inside_the_mid_plane() -> None:
    radii = contraction(np.linspace(0.0, 2.0, 9))
    assert radii[0] == 1.0
    assert np.all(np.diff(radii) < 0.0)
    assert radii[-1] > 0.85


def test_elliptic_integrals_to_rounding() -> None:
    m = np.array([0.0, 1e-6, 0.3, 0.9, 0.999, 1.0 - 1e-9])
    K, E = complete_elliptic(m)
    np.testing.assert_allclose(K, ellipk(m), rtol=1e-9)
    np.testing.assert_allclose(E, ellipe(m), rtol=1e-13)
