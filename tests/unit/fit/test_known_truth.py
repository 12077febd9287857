"""Known truth: over fixed seeds, intervals hold the truth as often as they say."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.fit_result import FitResult
from benchtool.fit.ensemble import fit_ensemble
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.problem import Problem
from benchtool.fit.profile import with_profile
from tests.unit.fit.cases import QUAD_TRUTH, quad_problem, scaled_line

LINE_TRUTH = {"a": 1.0, "b": 2.0, "noise.scale": 3.0}


def held(results: list[FitResult], truth: dict[str, float]) -> tuple[float, float]:
    """Return how often the 68 % and 95 % intervals held the truth, over all parameters."""
    inside = [
        (
            result[name].interval_68[0] <= value <= result[name].interval_68[1],
            result[name].interval_95[0] <= value <= result[name].interval_95[1],
        )
        for result in results
        for name, value in truth.items()
    ]
    one, two = np.mean(inside, axis=0)
    return float(one), float(two)


def check_held(results: list[FitResult], truth: dict[str, float]) -> None:
    """Check both rates against four binomial deviations, parameters taken as one draw."""
    one, two = held(results, truth)
    n = len(results)
    assert one == pytest.approx(0.6827, abs=4.0 * np.sqrt(0.68 * 0.32 / n) / np.sqrt(2.0))
    assert two == pytest.approx(0.95, abs=4.0 * np.sqrt(0.95 * 0.05 / n) / np.sqrt(2.0))


def problems(count: int) -> list[Problem]:
    """Return simulated plate sweeps of one truth."""
    return [quad_problem(1000 + seed) for seed in range(count)]


def test_least_squares_holds_k_radius_and_body_lift() -> None:
    check_held([fit_least_squares(problem) for problem in problems(300)], QUAD_TRUTH)


@pytest.mark.slow
def test_profiles_hold_them_too() -> None:
    check_held([with_profile(p, fit_least_squares(p)) for p in problems(24)], QUAD_TRUTH)


def test_least_squares_holds_a_scale_it_estimates() -> None:
    results = [fit_least_squares(scaled_line(seed)) for seed in range(2000, 2400)]
    check_held(results, LINE_TRUTH)


@pytest.mark.slow
def test_emcee_holds_k_radius_and_body_lift() -> None:
    check_held([fit_ensemble(problem) for problem in problems(12)], QUAD_TRUTH)
