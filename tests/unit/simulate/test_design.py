"""Designs of campaigns: grids, random points, cells, and ranges that are none."""

from __future__ import annotations

import pytest

from benchtool.core.errors import InputError
from benchtool.simulate.design import Design, Vary

K_B, ATTITUDE = "K_b=1.5:2.5:3", "gains.attitude=0.8:1.2:2"


def test_a_grid_and_random_points():
    grid = Design.read([K_B, ATTITUDE])
    points = list(grid.points())
    assert len(points) == grid.n_points == 6
    assert points[1] == {"K_b": 1.5, "gains.attitude": 1.2}
    chance = Design.read([K_B, ATTITUDE], samples=50, seed=1)
    random = list(chance.points())
    assert len(random) == chance.n_points == 50
    assert random == list(chance.points())
    assert random != list(Design.read([K_B, ATTITUDE], samples=50, seed=2).points())
    assert all(1.5 <= point["K_b"] <= 2.5 for point in random)


@pytest.mark.parametrize(
    "text", ["K_b", "K_b=1:2", "K_b=1:2:0", "K_b=1:2:-3", "K_b=a:2:3", "=1:2:3", "K=1:nan:3"]
)
def test_text_that_is_no_range_is_refused(text):
    with pytest.raises(InputError, match="write NAME=FROM:TO:COUNT"):
        Vary.read(text)
