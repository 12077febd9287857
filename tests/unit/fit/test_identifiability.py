"""How clearly data speak against a rival: the mean of what they do say, on a linear model."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.fit.identifiability import evidence_against

DESIGN = np.array([[1.0, 0.9], [0.0, 0.3], [0.5, 0.2], [-0.4, 0.1]]) * 8.0
INFORMATION = DESIGN.T @ DESIGN
SIZES = np.array([3.0, 0.0])
LOW, HIGH = np.array([-1.0, -np.inf]), np.array([1.0, np.inf])


def test_it_is_the_mean_ratio_over_many_recordings(rng: np.random.Generator) -> None:
    told = evidence_against(INFORMATION, SIZES, LOW, HIGH)
    ratios = []
    for _ in range(400):
        data = DESIGN @ SIZES + rng.standard_normal(4)
        # The rival is free, the truth held to its tolerance, which it reaches.
        left = data - DESIGN[:, 0]
        free = DESIGN[:, 1] * (left @ DESIGN[:, 1]) / (DESIGN[:, 1] @ DESIGN[:, 1])
        ratios.append(np.sum((left - free) ** 2) - np.sum((data - DESIGN @ SIZES) ** 2))
    # The rival has one number of its own to fit noise with.
    assert np.mean(ratios) + 1.0 == pytest.approx(told, rel=0.1)


def test_what_looks_the_same_cannot_be_told() -> None:
    twins = np.array([[4.0, 4.0], [4.0, 4.0]])
    assert evidence_against(twins, SIZES, LOW, HIGH) == pytest.approx(0.0, abs=1e-6)


def test_a_truth_within_bounds_is_no_evidence() -> None:
    assert evidence_against(INFORMATION, np.array([0.5, 0.0]), LOW, HIGH) == pytest.approx(
        0.0, abs=1e-6
    )
