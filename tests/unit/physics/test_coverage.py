"""Areas of a disc over half plane, strip and rectangle: closed forms, limits, Monte Carlo."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchtool.core.rig_file import load_rig_by_name
from benchtool.physics.conditions import plate_coverage
from benchtool.physics.images import half_plane_coverage, rectangle_coverage

lengths = st.floats(-3.0, 3.0)
radii = st.floats(0.05, 2.0)


def corner_area(x: float, y: float) -> float:
    """Return the area of the unit disc with abscissa below x and ordinate below y, case by case."""

    def half(s: float) -> float:
        return float(np.pi - np.arccos(s) + s * np.sqrt((1.0 - s) * (1.0 + s)))

    x, y = (min(max(v, -1.0), 1.0) for v in (x, y))
    if x * x + y * y >= 1.0:
        if x <= 0.0 and y <= 0.0:
            return 0.0
        if x >= 0.0 and y >= 0.0:
            return half(x) + half(y) - np.pi
        return half(min(x, y))
    u, v = np.sqrt((1.0 - x) * (1.0 + x)), np.sqrt((1.0 - y) * (1.0 + y))
    return float(x * y + 0.5 * (x * u + y * v + np.arcsin(x) + np.arcsin(y) + 0.5 * np.pi))


def test_half_plane_at_its_marks():
    inside = np.array([-5.0, -0.2, 0.0, 0.1, 0.2, 9.0])
    third = 1.0 - (np.arccos(0.5) - 0.5 * np.sqrt(0.75)) / np.pi
    np.testing.assert_allclose(
        half_plane_coverage(inside, 0.2), [0.0, 0.0, 0.5, third, 1.0, 1.0], atol=1e-15
    )
    area = 0.04 * (np.pi - np.arccos(0.35)) + 0.07 * np.sqrt(0.04 - 0.0049)
    assert half_plane_coverage(0.07, 0.2) * np.pi * 0.04 == pytest.approx(area, rel=1e-14)


@given(lengths, lengths, radii, lengths, lengths, lengths, lengths)
def test_rectangle_agrees_with_the_corner_formula(x, y, radius, a, b, c, d):
    (x1, x2), (y1, y2) = sorted((a, b)), sorted((c, d))
    u1, u2, v1, v2 = (x1 - x) / radius, (x2 - x) / radius, (y1 - y) / radius, (y2 - y) / radius
    area = corner_area(u2, v2) - corner_area(u1, v2) - corner_area(u2, v1) + corner_area(u1, v1)
    got = rectangle_coverage(x, y, radius, x1, x2, y1, y2)
    assert got == pytest.approx(area / np.pi, abs=1e-12)


@pytest.mark.parametrize(
    ("arm_m", "percent"), [(0.20, "50"), (0.225, "63"), (0.255, "78"), (0.283, "90")]
)
def test_front_disc_over_the_obstacle_in_case_2(arm_m, percent):
    """Compare the study's figures: body at x = 2.8, edge at 3.0, R = 0.12."""
    assert f"{100.0 * half_plane_coverage(2.8 + arm_m - 3.0, 0.12):.0f}" == percent


def test_coverage_of_every_rotor_follows_the_plate():
    rig = load_rig_by_name("pquad")
    rig = replace(rig, plate=replace(rig.plate, size_x_m=1.0, size_y_m=1.0))
    moved = plate_coverage(rig, np.array([-0.5, 0.0, 0.5, 5.0]))
    assert moved.shape == (4, 4)
    np.testing.assert_array_equal(moved[:, 1], np.ones(4))
    np.testing.assert_array_equal(moved[:, 3], np.zeros(4))
    np.testing.assert_allclose(moved[:, 2], [1.0, 0.5, 0.0, 0.5], atol=1e-15)
    np.testing.assert_allclose(moved[:, 0], [0.0, 0.5, 1.0, 0.5], atol=1e-15)
