"""The general sum against the printed equations, and its limits."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchtool.core.errors import UnknownChoice
from benchtool.physics.body_lift import (
    body_term,
    centre_distances_m,
    equal_arms,
    quad_body_lift_factor,
)
from benchtool.physics.images import (
    image_velocity,
    partial_factor,
    quad_factor,
    self_image,
    single_rotor_factor,
    three_rotor_average_factor,
    three_rotor_corner_factor,
    three_rotor_end_factor,
    thrust_factor,
)
from tests.unit.physics.general_sum import (
    axis_distances_m,
    body_images,
    denominator_sums,
    multirotor_factors,
    neighbour_images,
)
from tests.unit.physics.layouts import plus_layout

ROOT2 = np.sqrt(2.0)
radii = st.floats(0.02, 1.0)
ratios = st.floats(0.7, 12.0)
spacings = st.floats(2.1, 8.0)
lifts = st.floats(0.0, 2.5)


def square(spacing: float) -> np.ndarray:
    """Return four rotors on a square's corners (4, 2)."""
    h = 0.5 * spacing
    return np.array([[h, h], [-h, h], [-h, -h], [h, -h]])


@given(radii, st.floats(0.3, 12.0))
def test_one_rotor_is_equation_2(radius: float, ratio: float) -> None:
    general = multirotor_factors(radius, [ratio * radius], [1.0], np.zeros((1, 2)))
    assert general[0] == pytest.approx(single_rotor_factor(radius, ratio * radius), rel=1e-12)


@given(radii, ratios, spacings)
def test_four_rotors_are_equation_3(radius: float, ratio: float, spacing: float) -> None:
    z, d = ratio * radius, spacing * radius
    general = multirotor_factors(radius, np.full(4, z), np.ones(4), square(d))
    np.testing.assert_allclose(general, quad_factor(radius, z, d), rtol=1e-12)


@given(radii, ratios, spacings, lifts)
def test_four_rotors_with_body_are_equation_4_in_both_readings(
    radius: float, ratio: float, spacing: float, K_b: float
) -> None:
    z, d = ratio * radius, spacing * radius
    for reading, b in (("half_diagonal", d / ROOT2), ("diagonal", d * ROOT2)):
        sums = denominator_sums(radius, np.full(4, z), np.ones(4), square(d), K_b, 1.0, reading)
        printed = quad_body_lift_factor(radius, z, d, b, K_b)
        np.testing.assert_allclose(1.0 - sums, 1.0 / printed, rtol=0, atol=1e-12)


@given(radii, ratios, spacings)
def test_three_rotors_are_four_with_one_off(radius: float, ratio: float, spacing: float) -> None:
    z, d = ratio * radius, spacing * radius
    on = np.array([1.0, 1.0, 1.0, 0.0])
    general = multirotor_factors(radius, np.full(4, z), on, square(d))[:3]
    end, corner = (f(radius, z, d) for f in (three_rotor_end_factor, three_rotor_corner_factor))
    np.testing.assert_allclose(general, [end, corner, end], rtol=1e-12)
    average = three_rotor_average_factor(radius, z, d)
    assert average == pytest.approx(general.mean(), rel=1e-12)


@given(radii, st.floats(0.3, 12.0))
def test_own_image_is_the_image_at_no_distance(radius: float, ratio: float) -> None:
    z = ratio * radius
    own = radius * radius * image_velocity(z, 0.0)
    assert own == pytest.approx((radius / (4.0 * z)) ** 2, rel=1e-14)
    assert radius * radius * self_image(z) == pytest.approx(own, rel=1e-14)


def test_far_from_the_plate_there_is_no_ground_effect() -> None:
    for z in (1e3, 1e6):
        factor = quad_body_lift_factor(0.12, z, 0.318, 0.225, 2.0)
        assert 1.0 <= factor < 1.0 + 13.0 * (0.12 / (4.0 * z)) ** 2


def test_rotors_far_apart_are_single_rotors() -> None:
    single = single_rotor_factor(0.12, 0.12)
    assert quad_factor(0.12, 0.12, 1e4) == pytest.approx(single, rel=1e-12)
    assert quad_body_lift_factor(0.12, 0.12, 1e4, 1e4, 2.0) == pytest.approx(single, rel=1e-12)


def test_coincident_rotors_add_four_times() -> None:
    z = 0.3
    assert 1.0 - 1.0 / quad_factor(0.12, z, 0.0) == pytest.approx(
        4.0 * (0.12 / (4.0 * z)) ** 2, rel=1e-12
    )


@given(st.floats(0.05, 2.0))
def test_a_neighbour_counts_most_at_its_distance_over_two_root_two(distance: float) -> None:
    best = distance / (2.0 * ROOT2)
    nearby = image_velocity(best * np.linspace(0.5, 2.0, 301), distance)
    assert nearby.max() <= image_velocity(best, distance)
    peak = 1.0 / (6.0 * np.sqrt(3.0) * distance * distance)
    assert image_velocity(best, distance) == pytest.approx(peak, rel=1e-12)


@given(radii, ratios, spacings)
def test_factors_fall_with_height_beyond_the_neighbours(
    radius: float, ratio: float, spacing: float
) -> None:
    z, d = (ratio + 1.0) * radius, spacing * radius
    lower, higher = quad_factor(radius, z, d), quad_factor(radius, 1.01 * z, d)
    assert lower > higher > 1.0


def test_each_rotor_enters_with_its_own_height() -> None:
    layout = plus_layout(0.225)
    positions = np.stack([layout.x_m, layout.y_m], axis=1)
    height = np.array([0.15, 0.24, 0.33, 0.24])
    got = multirotor_factors(0.12, height, np.ones(4), positions, 2.0)
    for i, z in enumerate(height):
        printed = quad_body_lift_factor(0.12, z, 0.225 * ROOT2, 0.225, 2.0)
        assert got[i] == pytest.approx(printed, rel=1e-12)
    assert got[0] > got[1] > got[2]


def test_neighbours_count_by_their_coverage_and_a_rotor_not_as_its_own() -> None:
    distances = axis_distances_m(square(0.3))
    height = np.full(4, 0.2)
    coverage = np.array([0.9, 0.5, 0.0, 0.25])
    got = neighbour_images(0, height, coverage, distances)
    expected = 0.5 * image_velocity(0.2, 0.3) + 0.25 * image_velocity(0.2, 0.3)
    assert got == pytest.approx(expected, rel=1e-14)
    diagonal = neighbour_images(0, height, np.array([0.0, 0.0, 1.0, 0.0]), distances)
    assert diagonal == pytest.approx(image_velocity(0.2, 0.3 * ROOT2), rel=1e-14)


def test_arrays_go_along_after_the_rotor_axis() -> None:
    positions = square(0.318)
    height = np.linspace(0.1, 0.5, 12).reshape(1, 3, 4) * np.ones((4, 1, 1))
    coverage = np.linspace(0.0, 1.0, 48).reshape(4, 3, 4)
    whole = multirotor_factors(0.12, height, coverage, positions, 2.0, 0.5)
    assert whole.shape == (4, 3, 4)
    one = multirotor_factors(0.12, height[:, 1, 2], coverage[:, 1, 2], positions, 2.0, 0.5)
    np.testing.assert_allclose(whole[:, 1, 2], one, rtol=1e-15)


@given(st.floats(1.0, 3.0), st.floats(0.0, 1.0))
def test_the_increment_is_linear_in_the_covered_area(factor: float, area: float) -> None:
    assert partial_factor(factor, 0.0) == 1.0
    assert partial_factor(factor, 1.0) == pytest.approx(factor, rel=1e-15)
    got = partial_factor(factor, area) - 1.0
    assert got == pytest.approx(area * (factor - 1.0), abs=1e-15)


def test_the_body_term_is_four_images_at_half_the_diagonal() -> None:
    arms = centre_distances_m(*square(0.318).T)
    got = body_term(2.0, 1.0, 0.12, body_images(0.2, arms))
    b = 0.318 / ROOT2
    assert got == pytest.approx(2.0 * 2.0 * 0.12**2 * 0.2 / (b * b + 0.16) ** 1.5, rel=1e-12)
    assert body_term(0.0, 1.0, 0.12, body_images(0.2, arms)) == 0.0
    assert thrust_factor(0.0) == 1.0


def test_body_distances_of_any_layout() -> None:
    x, y = np.array([0.3, -0.1, 0.0]), np.array([0.4, 0.0, -0.2])
    np.testing.assert_allclose(centre_distances_m(x, y), [0.5, 0.1, 0.2])
    np.testing.assert_allclose(centre_distances_m(x, y, "diagonal"), [1.0, 0.2, 0.4])
    with pytest.raises(UnknownChoice, match=r"unknown body distance 'width'.*half_diagonal"):
        centre_distances_m(x, y, "width")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("arms_m", "counts"),
    [
        ([0.2, 0.2, 0.2, 0.2], (4, 0, 0, 0)),
        ([0.2, 0.3, 0.2 * (1.0 + 1e-15), 0.3], (2, 2, 0, 0)),
        ([0.2, 0.200001, 0.0], (1, 1, 1)),
    ],
)
def test_equal_arms_are_counted_once(arms_m: list[float], counts: tuple[int, ...]) -> None:
    assert equal_arms(np.array(arms_m)) == counts
