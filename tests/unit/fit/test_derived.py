"""Derived quantities and profile intervals, against algebra."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from benchtool.core.errors import EstimationError
from benchtool.fit.ensemble import fit_ensemble
from benchtool.fit.least_squares import add_profile_intervals, fit_least_squares
from benchtool.fit.model_problem import function_problem
from benchtool.fit.uncertainty.propagation import with_derived
from benchtool.physics.effects.effect import Derived
from benchtool.physics.effects.partial_coverage import derived, factors
from tests.unit.fit.cases import X, free, line_problem, noise

SUM = Derived("sum", "1", lambda v: v["a"] + v["b"])


def test_a_linear_combination_is_exact():
    result = with_derived(fit_least_squares(line_problem()), [SUM])
    total = result["sum"]
    assert total.value == pytest.approx(result["a"].value + result["b"].value)
    assert total.sd == pytest.approx(float(np.sqrt(result.covariance.sum())))
    assert total.interval_95[1] == pytest.approx(total.value + 1.959964 * total.sd, rel=1e-6)


def test_area_factors_are_those_of_the_effect():
    names = ["partial_coverage.share_1", "partial_coverage.share_2", "partial_coverage.share_3"]
    shares = [0.2, 0.5, 0.4]
    values = dict(zip(names, shares, strict=True))
    found = [quantity.function(values) for quantity in derived(names)]
    np.testing.assert_allclose(found, factors(shares), rtol=1e-13)
    assert derived(names)[0].name == "partial_coverage.factor_1"


def test_a_quantity_without_a_value_is_refused():
    result = fit_ensemble(line_problem())
    with np.errstate(all="ignore"), pytest.raises(EstimationError, match="no finite value for"):
        with_derived(result, [Derived("root", "1", lambda v: np.sqrt(v["a"] - 1e3))])


def test_the_profile_of_a_line_is_its_covariance():
    problem = line_problem()
    plain = fit_least_squares(problem)
    profiled = add_profile_intervals(problem, plain)
    for name in ("a", "b"):
        np.testing.assert_allclose(profiled[name].interval_95, plain[name].interval_95, rtol=1e-4)
        np.testing.assert_allclose(profiled[name].interval_68, plain[name].interval_68, rtol=1e-4)
    assert profiled.facts["intervals"] == "profile: a, b"


def test_a_profile_follows_the_bend_of_the_model():
    def root(v: Any) -> Any:
        return np.exp(v[0]) + 0.0 * X

    observed = 1.0 + 0.5 * noise(1)
    problem = function_problem("exp", {"a": free("a", 0.1)}, root, observed, np.full(len(X), 2.0))
    result = add_profile_intervals(problem, fit_least_squares(problem))
    mean, sd = observed.mean(), 2.0 / np.sqrt(len(X))
    low, high = result["a"].interval_68
    assert high == pytest.approx(np.log(mean + sd), rel=1e-3)
    assert low == pytest.approx(np.log(mean - sd), rel=1e-3)
    one_sided = add_profile_intervals(problem, fit_least_squares(problem))["a"].interval_95
    assert one_sided[1] == pytest.approx(np.log(mean + 1.959964 * sd), rel=1e-3)


def test_only_a_plain_least_squares_result_is_profiled():
    problem = line_problem()
    for result in (fit_least_squares(problem, loss="huber"), fit_ensemble(problem)):
        with pytest.raises(EstimationError, match="least-squares result with linear loss"):
            add_profile_intervals(problem, result)
