"""The ensemble sampler: its probability, its move, its convergence, its refusals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from benchtool.core.errors import EstimationError, InputError, NotConverged
from benchtool.fit.diagnose import find_error
from benchtool.fit.ensemble import check_convergence, fit_ensemble, split_rhat
from benchtool.fit.model_problem import function_problem
from benchtool.fit.problem import Problem
from benchtool.fit.sampling import log_probability
from tests.unit.fit.cases import SMALL, X, free, line_problem

Array = NDArray[np.float64]


def by_the_book(problem: Problem, values: Array) -> float:
    """Return the log posterior of one walker, each term by itself."""
    noise = {name: values[i] for i, name in enumerate(problem.free_names) if "noise" in name}
    shape = np.array([values[i] for i in problem.shape_index])
    sigma = problem.standard_error * noise.get("noise.scale", 1.0)
    sigma = np.sqrt(sigma**2 + noise.get("noise.sd", 0.0) ** 2)
    left = problem.observed - problem.predict(shape)
    total = float(np.sum(-0.5 * (left / sigma) ** 2 - np.log(sigma)))
    for name, value in zip(problem.free_names, values, strict=True):
        prior = problem.parameters[name].prior
        if prior.kind == "normal":
            total -= 0.5 * ((value - prior.mean) / prior.sd) ** 2
    return total - float(np.log(noise.get("noise.scale", 1.0)))


@pytest.mark.parametrize("name", SMALL)
def test_the_probability_is_the_one_of_the_book(name):
    problem = SMALL[name]()
    start = problem.parameters.pack()
    spread = 1.0 + 0.02 * np.random.default_rng(1).standard_normal((6, len(start)))
    walkers = start * spread
    found = log_probability(problem)(walkers)
    expected = np.array([by_the_book(problem, walker) for walker in walkers])
    np.testing.assert_allclose(found - found[0], expected - expected[0], rtol=1e-9, atol=1e-7)


def test_nothing_is_probable_outside_the_bounds_or_without_a_value():
    def root(v: Any) -> Any:
        return np.sqrt(v[0] - 1.0 + 0.0 * X)

    problem = function_problem(
        "root", {"a": free("a", 2.0, 0.0, 3.0)}, root, np.ones(len(X)), np.ones(len(X))
    )
    with np.errstate(all="ignore"):
        found = log_probability(problem)(np.array([[2.0], [3.5], [0.5]]))
    np.testing.assert_array_equal(np.isfinite(found), [True, False, False])


def test_a_normal_posterior_is_sampled_as_algebra_has_it():
    problem = line_problem()
    result = fit_ensemble(problem, seed=3)
    design = np.stack([np.ones(len(X)), X], axis=1) / 0.2
    covariance = np.linalg.inv(design.T @ design)
    mean = covariance @ design.T @ (problem.observed / 0.2)
    sd = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(result.values, mean, atol=0.05 * sd.min())
    np.testing.assert_allclose(result.covariance, covariance, rtol=0.06)
    a = result["a"]
    assert a.interval_95[0] == pytest.approx(mean[0] - 1.96 * sd[0], abs=0.1 * sd[0])
    assert a.interval_68[1] == pytest.approx(mean[0] + sd[0], abs=0.06 * sd[0])


def test_ensembles_that_disagree_are_seen():
    rng = np.random.default_rng(1)
    chains = rng.standard_normal((400, 4, 8, 2))
    good = check_convergence(chains)
    assert good.is_converged
    assert np.all(np.abs(good.tau_steps - 1.0) < 0.5)
    chains[:, 2, :, 1] += 0.5
    bad = check_convergence(chains)
    assert bad.rhat[0] < 1.01 < bad.rhat[1]
    assert not bad.is_mixed
    # A drift within every ensemble shows between their halves.
    drifting = rng.standard_normal((400, 4, 8, 1)) + np.linspace(0, 2, 400)[:, None, None, None]
    assert split_rhat(drifting)[0] > 1.05


def test_too_few_steps_give_advice_and_are_refused():
    result = fit_ensemble(line_problem(), max_steps=60)
    assert result.outcome.status == "not_converged"
    assert "allow more than 60 steps" in result.outcome.message
    refused = find_error([result])
    assert isinstance(refused, NotConverged)
    assert "allow more than 60 steps" in str(refused)
    assert find_error([fit_ensemble(line_problem())]) is None


def test_walkers_are_even_and_enough():
    with pytest.raises(InputError, match="7 walkers are invalid for 2 free parameters; allowed"):
        fit_ensemble(line_problem(), walkers=7)
    with pytest.raises(InputError, match="even numbers from 6"):
        fit_ensemble(line_problem(), walkers=4)


def test_undetermined_parameters_fill_their_bounds():
    def product(v: Any) -> Any:
        return v[0] * v[1] + X

    problem = function_problem(
        "product",
        {"a": free("a", 1.0, 0.5, 2.0), "b": free("b", 1.0, 0.5, 2.0)},
        product,
        1.0 + X,
        np.full(len(X), 0.5),
    )
    result = fit_ensemble(problem)
    assert result.outcome.status == "converged"
    assert result.samples.min() >= 0.5
    assert result.samples.max() <= 2.0
    assert result["a"].sd > 0.3
    assert any("posterior of a reaches its lower bound 0.5" in text for text in result.warnings)
    assert result["a"].bound == "reaches its lower bound"


def test_no_probable_start_is_told():
    def nowhere(v: Any) -> Any:
        return np.log(v[0] - 5.0) + 0.0 * X

    problem = function_problem(
        "nowhere", {"a": free("a", 1.0, 0.0, 2.0)}, nowhere, X, np.ones(len(X))
    )
    with pytest.raises(EstimationError, match="no points of finite probability"):
        fit_ensemble(problem)
