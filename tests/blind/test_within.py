"""How often a true model's gap is near its floor: counted over draws, in the worst channel."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from tests.blind.scoring import within


def test_the_worst_channel_counts_against_the_floor() -> None:
    floor = {"a": np.array([0.9, 1.0, 1.0, 1.2]), "b": np.array([2.0, 2.0, 2.6, 2.0])}
    learned = {"a": np.array([1.0, 1.05]), "b": np.array([2.3, 2.1])}
    assert (within(floor, floor, 1.1), within(learned, floor, 1.1)) == (0.5, 0.5)


def test_a_share_of_chi_squared_draws_is_that_of_its_distribution() -> None:
    drawn = {"thrust_N": np.random.default_rng(0).chisquare(50, 20_000) ** 0.5}
    more = {"thrust_N": 1.1 * drawn["thrust_N"]}
    expected = chi2.cdf(1.21 * chi2.median(50), 50)
    assert within(drawn, drawn, 1.1) == pytest.approx(expected, abs=0.01)
    assert within(more, drawn, 1.1) == pytest.approx(0.5, abs=0.01)
