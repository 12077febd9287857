"""Every named rule: what all have in common, and what each says of three rotors out of four."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.physics.wake_rules import WAKE_RULES, wake_rule


@pytest.mark.parametrize("name", sorted(WAKE_RULES))
@pytest.mark.parametrize("n", [2, 3, 4, 8])
def test_all_discs_covered_is_equation_4(name, n):
    assert wake_rule(name)(np.ones(n)) == pytest.approx(1.0, rel=1e-15)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("notes", 2 / 3), ("full", 1.0), ("mean", 0.75), ("product", 0.0), ("pairs", 0.5)],
)
def test_three_of_four(name, expected):
    assert wake_rule(name)(np.array([1.0, 1.0, 0.0, 1.0])) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("name", "expected"),
    [("notes", 0.0), ("full", 1.0), ("mean", 0.25), ("product", 0.0), ("pairs", 0.0)],
)
def test_one_of_four(name, expected):
    assert wake_rule(name)(np.array([1.0, 0.0, 0.0, 0.0])) == pytest.approx(expected)
