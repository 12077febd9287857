"""Every named rule: what all have in common, and what each says of three rotors out of four."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchtool.physics.wake_rules import WAKE_RULES, wake_rule

coverages = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8)


@pytest.mark.parametrize("name", sorted(WAKE_RULES))
@pytest.mark.parametrize("n", [2, 3, 4, 8])
def test_all_discs_covered_is_equation_4(name: str, n: int) -> None:
    assert wake_rule(name)(np.ones(n)) == pytest.approx(1.0, rel=1e-15)


@pytest.mark.parametrize("name", sorted(WAKE_RULES))
@given(given_coverages=coverages, raised=st.integers(0, 7), by=st.floats(0.0, 1.0))
def test_a_weight_is_a_share_and_grows_with_coverage(
    name: str, given_coverages: list[float], raised: int, by: float
) -> None:
    coverage = np.array(given_coverages)
    weight = wake_rule(name)(coverage)
    assert -1e-15 <= weight <= 1.0 + 1e-14
    more = coverage.copy()
    more[raised % coverage.size] += by * (1.0 - more[raised % coverage.size])
    assert wake_rule(name)(more) >= weight - 1e-14


@pytest.mark.parametrize(
    ("name", "expected"),
    [("notes", 2 / 3), ("full", 1.0), ("mean", 0.75), ("product", 0.0), ("pairs", 0.5)],
)
def test_three_of_four(name: str, expected: float) -> None:
    assert wake_rule(name)(np.array([1.0, 1.0, 0.0, 1.0])) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("notes", 0.0), ("full", 1.0), ("mean", 0.25), ("product", 0.0), ("pairs", 0.0)],
)
def test_one_of_four(name: str, expected: float) -> None:
    assert wake_rule(name)(np.array([1.0, 0.0, 0.0, 0.0])) == pytest.approx(expected)
