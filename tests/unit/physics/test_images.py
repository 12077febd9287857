"""Reference sum against the printed equations, and its limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchtool.core.errors import UnknownChoice
from benchtool.physics.body_lift import body_images
from benchtool.physics.images import image_velocity, partial_factor, self_image
from tests.unit.physics.closed_forms import (
    quad_body_lift_factor,
    quad_factor,
    single_rotor_factor,
    three_rotor_average_factor,
    three_rotor_corner_factor,
    three_rotor_end_factor,
)
from tests.unit.physics.general_sum import denominator_sums, multirotor_factors

ROOT2 = np.sqrt(2.0)
radii = st.floats(0.02, 1.0)
ratios = st.floats(0.7, 12.0)
spacings = st.floats(2.1, 8.0)
lifts = st.floats(0.0, 2.5)


def square(spacing: float) -> np.ndarray:
    """Return four rotors at the corners of a square (4, 2)."""
    h = 0.5 * spacing
    return np.array([[h, h], [-h, h], [-h, -h], [h, -h]])


@given(radii, st.floats(0.3, 12.0))
def test_one_rotor_is_equation_2(radius, ratio):
    general = multirotor_factors(radius, ratio * radius, [1.0], np.zeros((1, 2)))
    assert general[0] == pytest.approx(single_rotor_factor(radius, ratio * radius), rel=1e-12)


@given(radii, ratios, spacings)
def test_four_rotors_are_equation_3(radius, ratio, spacing):
    z, d = ratio * radius, spacing * radius
    general = multirotor_factors(radius, z, np.ones(4), square(d))
    np.testing.assert_allclose(general, quad_factor(radius, z, d), rtol=1e-12)


@given(radii, ratios, spacings, lifts)
def test_four_rotors_with_body_are_equation_4_for_both_b(radius, ratio, spacing, K_b):
    z, d = ratio * radius, spacing * radius
    for b_rule, b in (("half_diagonal", d / ROOT2), ("diagonal", d * ROOT2)):
        sums = denominator_sums(radius, z, np.ones(4), square(d), K_b, 1.0, b_rule)
        printed = quad_body_lift_factor(radius, z, d, b, K_b)
        np.testing.assert_allclose(1.0 - sums, 1.0 / printed, rtol=0, atol=1e-12)


@given(radii, ratios, spacings)
def test_three_rotors_are_four_with_one_off(radius, ratio, spacing):
    z, d = ratio * radius, spacing * radius
    on = np.array([1.0, 1.0, 1.0, 0.0])
    general = multirotor_factors(radius, z, on, square(d))[:3]
    end, corner = (f(radius, z, d) for f in (three_rotor_end_factor, three_rotor_corner_factor))
    np.testing.assert_allclose(general, [end, corner, end], rtol=1e-12)
    average = three_rotor_average_factor(radius, z, d)
    assert average == pytest.approx(general.mean(), rel=1e-12)


@given(radii, st.floats(0.3, 12.0))
def test_own_image_is_the_image_at_no_distance(radius, ratio):
    z = ratio * radius
    image = radius * radius * image_velocity(z, z, 0.0)
    assert image == pytest.approx((radius / (4.0 * z)) ** 2, rel=1e-14)
    assert radius * radius * self_image(z) == pytest.approx(image, rel=1e-14)


def test_far_from_the_plate_there_is_no_ground_effect():
    for z in (1e3, 1e6):
        factor = quad_body_lift_factor(0.12, z, 0.318, 0.225, 2.0)
        assert 1.0 <= factor < 1.0 + 13.0 * (0.12 / (4.0 * z)) ** 2


def test_rotors_far_apart_are_single_rotors():
    single = single_rotor_factor(0.12, 0.12)
    assert quad_factor(0.12, 0.12, 1e4) == pytest.approx(single, rel=1e-12)
    assert quad_body_lift_factor(0.12, 0.12, 1e4, 1e4, 2.0) == pytest.approx(single, rel=1e-12)


def test_coincident_rotors_add_four_times():
    z = 0.3
    assert 1.0 - 1.0 / quad_factor(0.12, z, 0.0) == pytest.approx(
        4.0 * (0.12 / (4.0 * z)) ** 2, rel=1e-12
    )


@given(st.floats(0.05, 2.0))
def test_a_neighbour_image_is_strongest_at_distance_over_two_root_two(distance):
    best = distance / (2.0 * ROOT2)
    z = best * np.linspace(0.5, 2.0, 301)
    assert image_velocity(z, z, distance).max() <= image_velocity(best, best, distance)
    peak = 1.0 / (6.0 * np.sqrt(3.0) * distance * distance)
    assert image_velocity(best, best, distance) == pytest.approx(peak, rel=1e-12)


@given(radii, ratios, spacings)
def test_factors_fall_with_height_beyond_the_neighbours(radius, ratio, spacing):
    z, d = (ratio + 1.0) * radius, spacing * radius
    lower, higher = quad_factor(radius, z, d), quad_factor(radius, 1.01 * z, d)
    assert lower > higher > 1.0


@given(st.floats(1.0, 3.0), st.floats(0.0, 1.0))
def test_the_increment_is_linear_in_the_covered_area(factor, area):
    assert partial_factor(factor, 0.0) == 1.0
    assert partial_factor(factor, 1.0) == pytest.approx(factor, rel=1e-15)
    got = partial_factor(factor, area) - 1.0
    assert got == pytest.approx(area * (factor - 1.0), abs=1e-15)


def test_the_sources_of_the_body_term_for_any_layout():
    x, y = np.array([0.3, -0.1, 0.0]), np.array([0.4, 0.0, -0.2])
    np.testing.assert_allclose(body_images(x, y), [x, y, [0.5, 0.1, 0.2]])
    np.testing.assert_allclose(body_images(x, y, "diagonal"), [2.0 * x, 2.0 * y, [1.0, 0.2, 0.4]])
    plus = body_images(x, y, half_diagonal_m=0.3)
    np.testing.assert_allclose(plus, [[0.3, 0, -0.3, 0], [0, 0.3, 0, -0.3], [0.3] * 4])
    with pytest.raises(UnknownChoice, match=r"unknown body distance 'width'.*half_diagonal"):
        body_images(x, y, "width")  # type: ignore[arg-type]
