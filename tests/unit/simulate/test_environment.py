"""Boxes, ramps, plates and grids, and what discs see of them."""

from __future__ import annotations

from dataclasses import replace
from math import inf

import numpy as np
import pytest

from benchtool.core.errors import InputError
from benchtool.physics.images import rectangle_coverage
from benchtool.simulate.flight.environment import Block, Environment, HeightGrid
from benchtool.simulate.flight.ground import Below, disc_on_rectangle
from benchtool.simulate.flight.vehicle import FlightVehicle
from tests.unit.physics.general_sum import multirotor_factors
from tests.unit.simulate.flying import PQUAD, look_below, static_moments_Nm

OBSTACLE = Environment(blocks=(Block(x_m=(3.0, 5.0)),))


def below(
    environment: Environment, x: float, y: float = 0.0, z: float = 0.24, time_s: float = 0.0,
    attitude: tuple[float, float, float] = (0.0, 0.0, 0.0), vehicle: FlightVehicle = PQUAD,
) -> Below:  # fmt: skip
    return look_below(vehicle, environment, (x, y, z), time_s, attitude)


def grid_of(step_m: float, floor: float = np.nan) -> HeightGrid:
    x, y = np.arange(-1.0, 7.0, step_m), np.arange(-1.5, 1.5 + step_m, step_m)
    rise = (x[:, None] >= 3.0) & (x[:, None] <= 5.0) & np.ones((1, len(y)), bool)
    return HeightGrid(x, y, np.where(rise, 0.0, floor), base_m=-0.5)


def test_wall_of_the_notes():
    places = [2.8, 2.9, 3.0, 3.05, 3.1, 3.15, 3.2, 3.25, 3.3, 3.4]
    at = np.array([[x, 0.0, 0.24] for x in places])
    moments = static_moments_Nm(PQUAD, OBSTACLE, at) * 1e3
    backward = [7.7, 14.8, 45.5, 63.7, 78.6, 74.4, 58.4, 37.0, 14.0, 0.0]
    np.testing.assert_allclose(-moments[:, 1], backward, atol=0.06)
    np.testing.assert_allclose(moments[:, 0], 0.0, atol=1e-13)
    assert below(OBSTACLE, 3.1).coverage == pytest.approx((1.0, 0.96, 0.0, 0.96), abs=1e-3)


def test_level_over_everything_is_the_bench_formula():
    ground = below(OBSTACLE, 4.0)
    expected = multirotor_factors(0.12, 0.24, np.ones(4), PQUAD.rig.disc_positions_m, 2.0)
    np.testing.assert_allclose(ground.factor, expected, rtol=1e-13)
    assert ground.coverage == (1.0,) * 4


def test_a_ramp_under_a_vehicle_that_leans_with_it_is_level_ground():
    """Only the tilt between rotor plane and surface counts, not that against the horizon."""
    lean = 0.15
    ramp = Environment(
        blocks=(Block(x_m=(-2.0, 2.0), top_m=2.0 * np.tan(lean), slope_x=-np.tan(lean)),)
    )
    along = below(ramp, 0.0, z=0.24 / np.cos(lean), attitude=(0.0, lean, 0.0))
    np.testing.assert_allclose(along.factor, below(OBSTACLE, 4.0).factor, rtol=1e-13)
    leaning = below(ramp, 0.0, z=0.24 / np.cos(lean))
    level = below(OBSTACLE, 4.0, attitude=(0.0, -lean, 0.0))
    np.testing.assert_allclose(leaning.factor, level.factor, rtol=1e-13)


def test_the_body_term_reaches_beyond_the_edge_of_its_surface():
    """Three rotors over a box share its body term, taken at the centre's height over the box."""
    tilted = below(OBSTACLE, 3.1, attitude=(0.0, 0.1, 0.0))
    covered = np.array(tilted.coverage)
    weight = max(0.0, (covered.sum() - 1.0) / 3.0)
    full = multirotor_factors(
        0.12, 0.24, covered, PQUAD.rig.disc_positions_m, 2.0, weight, pitch_rad=0.1
    )
    np.testing.assert_allclose(tilted.factor, 1.0 + covered * (full - 1.0), rtol=1e-13)
    assert 0.0 == covered[2] < covered[0] == 1.0


def test_a_plate_slides_in_and_out():
    plate = Environment(
        blocks=(Block(x_m=(0.1, 1.0), times_s=(10.0, 10.5, 30.0, 30.5), slide_m=(1.0, 0.0)),)
    )
    covered = [below(plate, 0.0, time_s=t).coverage[0] for t in (0.0, 10.45, 20.0, 30.05, 40.0)]
    assert covered[0] == covered[4] == 0.0
    assert covered[2] == 1.0
    assert 0.0 < covered[1] < 1.0
    assert covered[3] == pytest.approx(covered[1], abs=1e-9)


@pytest.mark.parametrize(
    ("make", "says"),
    [
        (lambda: Block(x_m=(5.0, 3.0)), "x_m is 5 to 3 m"),
        (lambda: Block(x_m=(3.0, inf), slope_x=0.1), "needs finite ends"),
        (lambda: Block(x_m=(3.0, 5.0), top_m=np.nan), "top_m is nan"),
        (lambda: Block(x_m=(0.0, 1.0), times_s=(2.0, 1.0, 3.0, 4.0)), "do not increase"),
        (
            lambda: Environment(blocks=(Block(x_m=(0.0, 2.0)), Block(x_m=(1.0, 3.0), name="b"))),
            "'box' and 'b' overlap",
        ),
        (lambda: Environment(blocks=(Block(x_m=(0.0, 2.0)),), floor_m=0.0), "not above the floor"),
        (
            lambda: HeightGrid(np.array([0.0, 1.0, 3.0]), np.array([0.0, 1.0]), np.zeros((3, 2))),
            "evenly spaced",
        ),
        (
            lambda: HeightGrid(np.array([0.0, 1.0]), np.array([0.0, 1.0]), np.zeros((3, 2))),
            "one height per node",
        ),
        (
            lambda: grid_of(0.5).check_coverage(np.array([[0.0, 0.0], [9.0, 0.0]]), 0.3, "it"),
            "the map does not cover it: x is 9 m",
        ),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(make, says):
    with pytest.raises(InputError, match=says):
        make()


def test_an_edge_that_cuts_alone_is_worked_out_as_a_half_plane():
    rng = np.random.default_rng(4)
    for _ in range(2000):
        x1, y1 = rng.uniform(-0.3, 0.3, 2)
        x2, y2 = x1 + rng.uniform(0.05, 0.6), y1 + rng.uniform(0.05, 0.6)
        sides = [
            np.inf if far else value
            for far, value in zip(rng.random(2) < 0.3, (x2, y2), strict=True)
        ]
        place = (*rng.uniform(-0.3, 0.5, 2), 0.12, x1, sides[0], y1, sides[1])
        assert disc_on_rectangle(*place) == pytest.approx(rectangle_coverage(*place), abs=1e-12)


def test_an_undercarriage_touches_before_the_discs_do():
    assert below(OBSTACLE, 4.0, z=0.1).touching == 0.0
    legs = replace(PQUAD, undercarriage_m=0.11)
    touching = [below(OBSTACLE, x, z=0.1, vehicle=legs).touching for x in (4.0, 2.8, 2.6)]
    assert touching == [1.0, 1.0, 0.0]
