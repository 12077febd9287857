"""Probabilities of explanations: they sum to one and follow likelihood, gap and leftovers."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.explain.engine.describe import where_shown
from benchtool.explain.engine.subject import EARLY, LATE, RowGroups
from benchtool.explain.engine.thresholds import accepted, weighed

GOOD = accepted(ratio=0.9, leftover=0.75)
OPEN = accepted(ratio=3.0, leftover=0.75)
ROUGH = accepted(ratio=0.9, leftover=1.3)


@pytest.mark.parametrize("left", [GOOD, OPEN, ROUGH])
@pytest.mark.parametrize("gains", [{"a": 0.0, "b": 0.0}, {"a": 400.0, "b": 390.0}, {"a": 1e9}])
def test_they_sum_to_one(left: float, gains: dict[str, float]) -> None:
    found = weighed(gains, 1.0, left, left)
    assert sum(found.values()) == pytest.approx(1.0)
    assert min(found.values()) >= 0.0


def test_nothing_gained_is_nothing_missing() -> None:
    found = weighed(dict.fromkeys("abcdefgh", 0.0), 1.0, GOOD, GOOD)
    assert found["none"] > 0.95


def test_a_large_gain_that_closes_the_gap_is_believed() -> None:
    found = weighed({"a": 300.0, "b": 40.0}, 1.0, GOOD, OPEN)
    assert found["a"] > 0.95


def test_rivals_as_likely_share_the_belief() -> None:
    found = weighed({"a": 300.0, "b": 299.0}, 1.0, GOOD, OPEN)
    assert found["b"] > 0.3


@pytest.mark.parametrize("left", [OPEN, ROUGH])
def test_a_gain_that_leaves_too_much_is_doubted(left: float) -> None:
    assert weighed({"a": 5000.0}, 1.0, left, OPEN)["unknown"] > 0.95


def test_a_gap_that_nothing_closes_is_unknown() -> None:
    assert weighed({"a": 1.0}, 1.0, OPEN, OPEN)["unknown"] > 0.95


def test_larger_residuals_make_the_same_gain_tell_less() -> None:
    sharp = weighed({"a": 30.0, "b": 20.0}, 1.0, GOOD, GOOD)
    dull = weighed({"a": 30.0, "b": 20.0}, 4.0, GOOD, GOOD)
    assert dull["none"] > sharp["none"]


N = 900
TIME = np.arange(N)


@pytest.mark.parametrize(
    ("gained", "regime"),
    [
        (TIME >= 600, "high collective"),  # both begin together: the collective says more
        ((TIME >= 600) & (TIME < 700), "high collective"),
        (TIME >= 750, LATE),  # the high collective ends before it is worst
        (TIME < 300, EARLY),
    ],
)
def test_the_clock_is_named_only_where_nothing_else_fits_about_as_well(
    gained: np.ndarray, regime: str
) -> None:
    groups = RowGroups(
        stages={"hinge": np.ones(N, bool)},
        regimes={
            LATE: TIME >= 600,
            EARLY: TIME < 300,
            "high collective": (TIME >= 590) & (TIME < 790),
            "plate in": TIME % 2 == 0,
        },
    )
    before = np.where(gained, 3.0, 1.0)
    found = where_shown(groups, before, np.ones(N), "hinge")
    assert found is not None
    assert (found.stage, found.regime) == ("hinge", regime)


def test_of_equal_regimes_that_of_the_clock_comes_last() -> None:
    same = TIME >= 600
    groups = RowGroups(
        stages={"hinge": np.ones(N, bool)}, regimes={LATE: same, "high collective": same}
    )
    found = where_shown(groups, np.where(same, 2.0, 1.0), np.ones(N), "hinge")
    assert found is not None
    assert found.regime == "high collective"
    assert found.share == pytest.approx(1.0)
