"""What a visit's past was: since when the plate stands, where it came from, how much turned."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.physics.conditions import moves, past_means
from benchtool.physics.effects.effect import PAST_S

TIME_S = np.array([0.0, 10.0, 20.0, 40.0, 50.0, 70.0])
Z_M = np.array([0.2, 0.2, np.nan, 0.1, 0.1, 0.3])
PLACE = np.array([Z_M, np.zeros(6), np.zeros(6)])


def test_a_plate_moves_half_way_between_two_visits_and_comes_from_a_side():
    since_s, side = moves(TIME_S, PLACE)
    assert since_s.tolist() == [0.0, 10.0, 20.0, 10.0, 20.0, 10.0]
    assert side.tolist() == [0.0, 0.0, 0.0, -1.0, -1.0, 1.0]


def test_visits_may_stand_in_any_order():
    order = np.array([3, 0, 5, 1, 4, 2])
    for now, then in zip(moves(TIME_S[order], PLACE[:, order]), moves(TIME_S, PLACE), strict=True):
        assert now.tolist() == then[order].tolist()


def test_a_mean_over_the_past_follows_what_is_within_its_time():
    time_s = np.arange(0.0, 600.0, 2.0)
    means = past_means(time_s, time_s, np.where(time_s < 300.0, 1.0, 0.0))
    for mean, forgets_s in zip(means, PAST_S, strict=True):
        assert mean[149] == pytest.approx(1.0 - np.exp(-298.0 / forgets_s), abs=1e-9)
        assert mean[160] == pytest.approx(mean[149] * np.exp(-22.0 / forgets_s), abs=1e-9)


def test_motors_stand_still_while_the_plate_moves():
    time_s = np.array([0.0, 2.0, 4.0, 104.0])
    moved_s = np.array([0.0, 2.0, 4.0, 50.0])
    means = past_means(time_s, moved_s, np.ones(4))
    forgot = 1.0 - np.exp(-4.0 / 10.0)
    assert means[0, 2] == pytest.approx(forgot)
    expected = 1.0 + (forgot * np.exp(-98.0 / 10.0) - 1.0) * np.exp(-2.0 / 10.0)
    assert means[0, 3] == pytest.approx(expected)
