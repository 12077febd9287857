"""What every estimator owes, on every small problem."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from benchtool.core.fit_result import FitResult
from benchtool.fit.ensemble import fit_ensemble
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.problem import Problem
from tests.unit.fit.cases import SMALL

ESTIMATORS = {"least_squares": fit_least_squares, "emcee": fit_ensemble}

every_pair = pytest.mark.parametrize(
    ("method", "name"), [(method, name) for method in ESTIMATORS for name in SMALL]
)


@cache
def fitted(method: str, name: str) -> tuple[Problem, FitResult]:
    """Fit one problem once for all tests."""
    problem = SMALL[name]()
    return problem, ESTIMATORS[method](problem)


@every_pair
def test_answers_in_the_order_and_units_of_the_problem(method, name):
    problem, result = fitted(method, name)
    assert result.method == method
    assert result.outcome.status == "converged"
    assert result.outcome.evaluations > 0
    assert [estimate.name for estimate in result.estimates] == list(problem.free_names)
    for estimate in result.estimates:
        assert estimate.unit == problem.parameters[estimate.name].unit
    n = len(problem.free_names)
    assert result.covariance.shape == (n, n)
    np.testing.assert_allclose(result.covariance, result.covariance.T, rtol=1e-9, atol=1e-30)
    sds = [estimate.sd for estimate in result.estimates]
    np.testing.assert_allclose(np.sqrt(np.diag(result.covariance)), sds, rtol=0.02)
    assert result.dof == problem.dof
    assert result.model == problem.model
    assert result.facts["points"] == len(problem)


@every_pair
def test_intervals_enclose_the_value_and_each_other(method, name):
    problem, result = fitted(method, name)
    for estimate in result.estimates:
        low95, high95 = estimate.interval_95
        low68, high68 = estimate.interval_68
        assert low95 <= low68 <= estimate.value <= high68 <= high95
        item = problem.parameters[estimate.name]
        assert item.lower <= low95
        assert high95 <= item.upper


@every_pair
def test_the_problem_is_left_as_it_was(method, name):
    problem, _ = fitted(method, name)
    fresh = SMALL[name]()
    np.testing.assert_array_equal(problem.parameters.pack(), fresh.parameters.pack())
    np.testing.assert_array_equal(problem.observed, fresh.observed)


@pytest.mark.parametrize("name", SMALL)
def test_both_estimators_agree(name):
    _, one = fitted("least_squares", name)
    problem, other = fitted("emcee", name)
    for estimate in one.estimates:
        sampled = other[estimate.name]
        # A noise parameter's posterior is skewed: median against the chi2 estimate.
        close = 0.5 if estimate.name == problem.noise_name else 0.15
        assert abs(sampled.value - estimate.value) < close * estimate.sd
        assert sampled.sd == pytest.approx(estimate.sd, rel=0.25 if close == 0.5 else 0.1)
        assert sampled.interval_95[0] == pytest.approx(
            estimate.interval_95[0], abs=(0.9 if close == 0.5 else 0.3) * estimate.sd
        )
    assert other.chi2 == pytest.approx(one.chi2, rel=1e-3) or problem.noise_name is not None
    assert other.log_likelihood >= one.log_likelihood - 0.05


@pytest.mark.parametrize("method", ESTIMATORS)
def test_the_same_problem_gives_the_same_answer(method):
    _, first = fitted(method, "decay")
    again = ESTIMATORS[method](SMALL["decay"]())
    np.testing.assert_array_equal(first.values, again.values)
    np.testing.assert_array_equal(first.samples, again.samples)
