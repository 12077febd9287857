"""Every row and sign of the mixer, for plus, cross and any other layout."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.errors import InputError, UnknownChoice
from benchtool.physics.mixer import (
    WRENCH,
    RotorLayout,
    allocate,
    cross_layout,
    mixer_matrix,
    pitch_moment_Nm,
    plus_layout,
    roll_moment_Nm,
    rotor_layout,
)

K, C, ARM = 1.2e-5, 1.8e-7, 0.225


def matrix_of(layout: RotorLayout) -> np.ndarray:
    """Return the mixer of a layout with this file's coefficients."""
    return mixer_matrix(layout.x_m, layout.y_m, layout.spin, K, C)


def test_the_plus_mixer_is_equation_9_entry_by_entry() -> None:
    layout = plus_layout(ARM)
    assert layout.names == ("front", "left", "rear", "right")
    printed = [
        [K, K, K, K],
        [0, K * ARM, 0, -K * ARM],
        [-K * ARM, 0, K * ARM, 0],
        [-C, C, -C, C],
    ]
    np.testing.assert_allclose(matrix_of(layout), printed, rtol=1e-15, atol=0)


ROWS = {row: number for number, row in enumerate(WRENCH)}


@pytest.mark.parametrize(
    ("row", "signs"),
    [
        ("thrust_N", {"front": 1, "left": 1, "rear": 1, "right": 1}),
        ("roll_Nm", {"front": 0, "left": 1, "rear": 0, "right": -1}),
        ("pitch_Nm", {"front": -1, "left": 0, "rear": 1, "right": 0}),
        ("yaw_Nm", {"front": -1, "left": 1, "rear": -1, "right": 1}),
    ],
)
def test_signs_of_every_row_plus(row: str, signs: dict[str, int]) -> None:
    layout = plus_layout(ARM)
    got = dict(zip(layout.names, np.sign(matrix_of(layout)[ROWS[row]]), strict=True))
    assert got == signs


@pytest.mark.parametrize(
    ("row", "signs"),
    [
        ("thrust_N", {"front_left": 1, "rear_left": 1, "rear_right": 1, "front_right": 1}),
        ("roll_Nm", {"front_left": 1, "rear_left": 1, "rear_right": -1, "front_right": -1}),
        ("pitch_Nm", {"front_left": -1, "rear_left": 1, "rear_right": 1, "front_right": -1}),
        ("yaw_Nm", {"front_left": -1, "rear_left": 1, "rear_right": -1, "front_right": 1}),
    ],
)
def test_signs_of_every_row_cross(row: str, signs: dict[str, int]) -> None:
    layout = cross_layout(ARM)
    got = dict(zip(layout.names, np.sign(matrix_of(layout)[ROWS[row]]), strict=True))
    assert got == signs


def test_the_cross_is_the_plus_turned_by_45_degrees() -> None:
    plus, cross = matrix_of(plus_layout(ARM)), matrix_of(cross_layout(ARM))
    np.testing.assert_allclose(cross[[0, 3]], plus[[0, 3]], rtol=1e-15)
    turn = np.deg2rad(45.0)
    turned = RotorLayout(
        plus_layout(ARM).names,
        ARM * np.cos(turn + 0.5 * np.pi * np.arange(4)),
        ARM * np.sin(turn + 0.5 * np.pi * np.arange(4)),
        plus_layout(ARM).spin,
    )
    np.testing.assert_allclose(cross, matrix_of(turned), rtol=1e-14)
    np.testing.assert_allclose(np.hypot(cross[1], cross[2]), K * ARM, rtol=1e-14)


def test_moments_are_arm_times_force(rng: np.random.Generator) -> None:
    """Compare with the cross product r x F and with drag opposing the spin."""
    n = 7
    x, y = rng.uniform(-0.5, 0.5, (2, n))
    spin = rng.choice([-1.0, 1.0], n)
    squares = rng.uniform(1e4, 1e6, n)
    places = np.stack([x, y, np.zeros(n)], axis=1)
    forces = np.stack([np.zeros(n), np.zeros(n), K * squares], axis=1)
    torque = np.cross(places, forces).sum(axis=0)
    torque[2] += -(spin * C * squares).sum()
    got = mixer_matrix(x, y, spin, K, C) @ squares
    np.testing.assert_allclose(got, [forces[:, 2].sum(), *torque], rtol=1e-12)
    assert roll_moment_Nm(K * squares, y) == pytest.approx(torque[0], rel=1e-12)
    assert pitch_moment_Nm(K * squares, x) == pytest.approx(torque[1], rel=1e-12)


def test_more_thrust_in_front_is_a_backward_moment() -> None:
    layout = plus_layout(ARM)
    assert pitch_moment_Nm([4.0, 3.0, 3.0, 3.0], layout.x_m) == pytest.approx(-ARM)
    assert pitch_moment_Nm(np.full((4, 5), 3.0), layout.x_m) == pytest.approx(np.zeros(5))


@pytest.mark.parametrize("name", ["plus", "cross"])
def test_allocation_is_the_inverse(name: str, rng: np.random.Generator) -> None:
    matrix = matrix_of(rotor_layout(name, ARM))
    squares = rng.uniform(1e5, 1e6, (4, 9))
    np.testing.assert_allclose(allocate(matrix, matrix @ squares), squares, rtol=1e-10)


def test_allocation_to_eight_rotors_gives_the_wrench_with_least_squares(
    rng: np.random.Generator,
) -> None:
    angle = 0.25 * np.pi * np.arange(8)
    matrix = mixer_matrix(0.6 * np.cos(angle), 0.6 * np.sin(angle), np.tile([1.0, -1.0], 4), K, C)
    wrench = np.array([100.0, 0.4, -0.7, 0.05])
    squares = allocate(matrix, wrench)
    np.testing.assert_allclose(matrix @ squares, wrench, rtol=1e-10)
    nullspace = np.linalg.svd(matrix)[2][4:]
    np.testing.assert_allclose(nullspace @ squares, 0.0, atol=1e-10 * np.linalg.norm(squares))


def test_allocation_to_one_rotor_gives_the_thrust_it_can() -> None:
    matrix = mixer_matrix([0.0], [0.0], [1.0], K, 0.0)
    squares = allocate(matrix, np.array([3.0, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(squares, [3.0 / K], rtol=1e-12)


def test_a_mixer_needs_every_rotor() -> None:
    with pytest.raises(InputError, match="got 2, 1 and 2 values"):
        mixer_matrix([0.1, 0.2], [0.1], [1, -1], K, C)


def test_an_unknown_layout_lists_the_known_ones() -> None:
    with pytest.raises(UnknownChoice, match=r"unknown rotor layout 'x'.*cross, plus"):
        rotor_layout("x", ARM)
