"""What an experiment is expected to say between rivals, held against dense Gaussians."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from benchtool.core.units import Array
from benchtool.explain.engine.design import (
    MAX_CONFUSION,
    CandidatePrediction,
    ExpectedOutcome,
    select_design,
)

ROWS, NUMBERS, BENCHES = 12, 4, 40
FAR = np.full(NUMBERS - 1, 1e3)


def outlook(rng: np.random.Generator, room: Array = FAR) -> CandidatePrediction:
    """Make a rival with some numbers that bounds may hold, and a discrepancy behind them."""
    root = rng.standard_normal((NUMBERS, NUMBERS))
    return CandidatePrediction(
        mean=rng.standard_normal(ROWS),
        slopes=0.5 * rng.standard_normal((ROWS, NUMBERS)),
        precision=root @ root.T + np.eye(NUMBERS),
        bounds=(-room, room),
    )


def density(one: CandidatePrediction) -> multivariate_normal:
    """Return the same as a dense Gaussian."""
    spread = one.slopes @ np.linalg.inv(one.precision) @ one.slopes.T
    return multivariate_normal(one.mean, np.eye(ROWS) + spread)


def test_gains_are_differences_of_log_densities():
    rng = np.random.default_rng(0)
    one, other = outlook(rng), outlook(rng)
    rows = one.draw(5, rng)
    expected = density(one).logpdf(rows.T) - density(other).logpdf(rows.T)
    assert one.log_evidence(rows) - other.log_evidence(rows) == pytest.approx(expected, rel=1e-9)


def test_the_quick_figure_is_the_divergence_of_dense_gaussians():
    rng = np.random.default_rng(1)
    one, other = outlook(rng), outlook(rng)
    a, b = density(one), density(other)
    inverse, missed = np.linalg.inv(b.cov), a.mean - b.mean
    dense = np.trace(inverse @ a.cov) - ROWS + missed @ inverse @ missed
    dense += np.linalg.slogdet(b.cov)[1] - np.linalg.slogdet(a.cov)[1]
    assert one.log_ratio(other, None) == pytest.approx(0.5 * dense, rel=1e-9)


def test_a_rival_at_its_bound_cannot_follow():
    """Bounds cost what is predicted beyond them, and nothing where they are far."""
    rng = np.random.default_rng(3)
    one = outlook(rng)
    rooms = FAR, 0.01 * np.ones(NUMBERS - 1)
    free, held = (replace(one, mean=one.mean + 3.0, bounds=(-room, room)) for room in rooms)
    assert one.log_ratio(held, rng) > one.log_ratio(free, rng) > 0.0


WORTH = {"a": 1.0, "b": 6.0, "c": 2.0}
TAKES_S = {"a": 30.0, "b": 60.0, "c": 60.0}


class Letters(str):
    duration_s = property(lambda self: sum(TAKES_S[name] for name in self))

    def extend(self) -> dict[str, Letters]:
        return {name: Letters(self + name) for name in WORTH if name not in self}


def test_a_design_grows_by_what_gains_most_for_its_time_and_stays_within_it():
    def expect(design: Letters) -> ExpectedOutcome:
        return ExpectedOutcome({}, float(np.exp(-0.25 * sum(WORTH[name] for name in design))))

    assert select_design(Letters(), expect, 100.0) == "ba"
    assert set(select_design(Letters(), expect, 1000.0)) == {"a", "b", "c"}
    complete = ExpectedOutcome({}, MAX_CONFUSION)
    assert select_design(Letters(), lambda design: complete, 1000.0) == ""
