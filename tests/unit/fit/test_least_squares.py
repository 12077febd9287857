"""Least squares beyond the certified answers: bounds, noise, losses, rank, starts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from benchtool.core.errors import EstimationError
from benchtool.core.fit_result import FitResult
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.model_problem import function_problem
from benchtool.fit.problem import Problem
from benchtool.fit.solve import central_differences, complex_step, select_method
from tests.unit.fit.cases import (
    QUAD_TRUTH,
    X,
    free,
    line,
    line_problem,
    noise,
    quad_problem,
    scaled_line,
    scattered_line,
)

FREE = np.full(2, np.inf)


@pytest.mark.parametrize("small", [0.0, 5e-324, -1e-200])
def test_a_number_next_to_nothing_has_a_derivative(small):
    def predict(v: Any) -> Any:
        return (v[0] + 2.0 * v[1]) * X

    values = np.array([1.0, small])
    np.testing.assert_allclose(complex_step(predict, values, len(X))[:, 1], 2.0 * X)
    plain = central_differences(predict, values, len(X), -FREE, FREE)
    np.testing.assert_allclose(plain[:, 1], 2.0 * X, rtol=1e-9)


def test_a_function_without_complex_arithmetic_is_noticed():
    def absolute(v: Any) -> Any:
        return np.abs(v[0]) * np.exp(-np.abs(v[1]) * X)

    def refuses(v: Any) -> Any:
        if np.iscomplexobj(v):
            raise TypeError("no complex numbers here")
        return v[0] * np.exp(-v[1] * X)

    values = np.array([2.0, 1.0])
    for function in (absolute, refuses):
        assert select_method(function, values, len(X), -FREE, FREE) == "central_differences"
        observed = 5.0 * np.exp(-3.0 * X)
        problem = function_problem(
            "f", {"a": free("a", 2.0), "b": free("b", 1.0)}, function, observed, np.ones(len(X))
        )
        result = fit_least_squares(problem)
        assert result.facts["derivatives"] == "central_differences"
        np.testing.assert_allclose(result.values, [5.0, 3.0], rtol=1e-7)


def test_a_stated_error_gives_the_textbook_covariance():
    result = fit_least_squares(line_problem())
    design = np.stack([np.ones(len(X)), X], axis=1) / 0.2
    np.testing.assert_allclose(result.covariance, np.linalg.inv(design.T @ design), rtol=1e-10)
    a = result["a"]
    assert a.interval_95[1] - a.value == pytest.approx(1.959964 * a.sd, rel=1e-6)
    assert a.interval_68[1] - a.value == pytest.approx(1.000022 * a.sd, rel=1e-5)


def test_a_free_scale_is_the_residual_deviation_with_student_intervals():
    problem = scaled_line()
    result = fit_least_squares(problem)
    left = problem.observed - line(result.values[:2])
    scale = np.sqrt(np.sum((left / 0.2) ** 2) / 23)
    assert result["noise.scale"].value == pytest.approx(scale, rel=1e-9)
    a = result["a"]
    assert (a.interval_95[1] - a.value) / a.sd == pytest.approx(2.0686576, rel=1e-6)  # t, 23 dof
    low, high = result["noise.scale"].interval_95
    assert 23 * (scale / np.array([high, low])) ** 2 == pytest.approx([11.68855, 38.07563])
    assert result.chi2_per_dof == pytest.approx(scale**2)
    assert a.sd == pytest.approx(scale * fit_least_squares(line_problem())["a"].sd)


def test_added_scatter_brings_chi2_to_its_degrees_of_freedom():
    problem = scattered_line()
    result = fit_least_squares(problem)
    sigma = np.hypot(0.2, result["noise.sd"].value)
    left = problem.observed - line(result.values[:2])
    assert np.sum((left / sigma) ** 2) == pytest.approx(23.0, rel=1e-6)
    assert result.chi2_per_dof > 1.5  # at the stated errors alone


@pytest.mark.parametrize("loss", ["soft_l1", "huber"])
def test_a_robust_loss_forgives_outliers(loss):
    problem = line_problem()
    observed = problem.observed.copy()
    observed[[3, 17]] += 10.0
    spoilt = replace(problem, observed=observed)
    clean = fit_least_squares(problem)
    robust = fit_least_squares(spoilt, loss=loss)
    plain = fit_least_squares(spoilt)
    assert abs(robust["a"].value - clean["a"].value) < 2.0 * clean["a"].sd
    assert abs(plain["a"].value - clean["a"].value) > 5.0 * clean["a"].sd
    assert clean["a"].sd < robust["a"].sd < 2.0 * clean["a"].sd
    assert robust.facts["loss"] == loss


def test_a_parameter_at_its_bound_is_told():
    problem = function_problem(
        "line",
        {"a": free("a", 0.5), "b": free("b", 0.5, 0.0, 1.5)},
        line,
        line_problem().observed,
        line_problem().standard_error,
    )
    result = fit_least_squares(problem)
    assert result["b"].value == pytest.approx(1.5, abs=1e-4)
    assert any("b ended at its upper bound 1.5" in text for text in result.warnings)
    assert result["b"].interval_95[1] <= 1.5


def test_parameters_that_only_act_together_are_told():
    def product(v: Any) -> Any:
        return v[0] * v[1] * X + v[2]

    problem = function_problem(
        "product",
        {"a": free("a", 1.0, 0.0, 9.0), "b": free("b", 1.5), "c": free("c", 0.0)},
        product,
        1.0 + 2.0 * X + 0.1 * noise(1),
        np.full(len(X), 0.1),
    )
    result = fit_least_squares(problem)
    assert result.outcome.status == "stopped_early"
    assert "do not determine a, b;" in result.outcome.message
    assert result["a"].sd == np.inf
    assert result["a"].interval_95 == (0.0, 9.0)
    assert result["c"].sd == pytest.approx(fit_least_squares(line_problem())["a"].sd / 2)


def test_more_parameters_than_points_are_told_not_fatal():
    few = line_problem().subset(np.array([4]))
    result = fit_least_squares(few)
    assert "do not determine a, b" in result.outcome.message
    with pytest.raises(EstimationError, match=r"no degree of freedom is left .*: 1 point,"):
        fit_least_squares(scaled_line().subset(np.array([4])))


def test_a_start_without_a_prediction_names_the_point():
    def pole(v: Any) -> Any:
        return v[0] / (X - X[3])

    problem = function_problem("pole", {"a": free("a", 1.0)}, pole, X, np.ones(len(X)))
    with pytest.raises(EstimationError, match="no finite prediction for point 4"):
        fit_least_squares(problem)


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


def test_least_squares_holds_k_radius_and_body_lift():
    check_held([fit_least_squares(problem) for problem in problems(300)], QUAD_TRUTH)
