"""Errors that points share: every estimator sees the covariance that linear algebra has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from benchtool.core.error_source import ErrorSource, Whitening
from benchtool.core.errors import InputError
from benchtool.fit.compare import compare, predictive_density
from benchtool.fit.least_squares import add_profile_intervals, fit_least_squares
from benchtool.fit.model_problem import function_problem
from benchtool.fit.problem import Problem
from benchtool.fit.sampling import log_probability
from benchtool.fit.uncertainty.propagation import propagate
from tests.unit.fit.cases import (
    Array,
    X,
    calibrated_line,
    free,
    line_problem,
    scaled_line,
    scattered_line,
)

DESIGN = np.stack([np.ones(25), X], axis=1)


def source(columns: Array, scaled: bool = False, name: str = "zero") -> ErrorSource:
    return ErrorSource(name=name, kind="B", unit="N", sd=0.1, columns=columns, scaled=scaled)


def blocks(size: float) -> Array:
    """Return columns (25, 5): every five points share a draw."""
    return size * np.kron(np.eye(5), np.ones((5, 1)))


def with_errors(problem: Problem) -> Problem:
    """Return the problem with one zero for all points and one place for every five of them."""
    zero, places = np.full((25, 1), 0.15), blocks(0.2)
    rng = np.random.default_rng(11)
    shifts = zero @ rng.standard_normal(1) + places @ rng.standard_normal(5)
    sources = (source(zero), source(places, scaled=True, name="place"))
    return replace(problem, observed=problem.observed + shifts, error_sources=sources)


def covariance_of(problem: Problem, scale: float = 1.0, sd: float = 0.0) -> Array:
    """Return V as the definition has it."""
    whole = np.diag((scale * problem.standard_error) ** 2 + sd**2)
    for one in problem.error_sources:
        columns = one.columns * scale if one.scaled else one.columns
        whole += columns @ columns.T
    return np.asarray(whole)


def line_by_algebra(problem: Problem, v: Array) -> tuple[Array, Array]:
    """Return the generalised least-squares line and its covariance."""
    covariance = np.linalg.inv(DESIGN.T @ np.linalg.solve(v, DESIGN))
    return covariance @ DESIGN.T @ np.linalg.solve(v, problem.observed), covariance


def test_whitening_is_a_root_of_the_inverse_covariance():
    rng = np.random.default_rng(1)
    sigma, columns = rng.uniform(0.5, 2.0, 9), rng.standard_normal((9, 4))
    v = np.diag(sigma**2) + columns @ columns.T
    whitening = Whitening(sigma, columns)
    root = whitening(np.eye(9))
    np.testing.assert_allclose(root.T @ root, np.linalg.inv(v), atol=1e-12)
    np.testing.assert_allclose(root @ sigma, whitening(sigma), rtol=1e-12)
    expected = 0.5 * np.linalg.slogdet(v)[1] - np.log(sigma).sum()
    assert whitening.log_root_excess == pytest.approx(expected)
    # Each row stays with its own point: the root is symmetric between standardised rows.
    np.testing.assert_allclose(root * sigma, (root * sigma).T, atol=1e-12)
    plain = Whitening(sigma, np.empty((9, 0)))
    np.testing.assert_array_equal(plain(columns), columns / sigma[:, None])


def test_a_source_of_other_points_is_refused():
    with pytest.raises(InputError, match="25 points were observed, but zero has 3 entries"):
        replace(line_problem(), error_sources=(source(np.ones((3, 1))),))


def test_least_squares_is_the_generalised_one():
    problem = with_errors(line_problem())
    v = covariance_of(problem)
    values, covariance = line_by_algebra(problem, v)
    result = fit_least_squares(problem)
    np.testing.assert_allclose(result.values, values, rtol=1e-9)
    np.testing.assert_allclose(result.covariance, covariance, rtol=1e-9)
    left = problem.observed - DESIGN @ values
    assert result.chi2 == pytest.approx(left @ np.linalg.solve(v, left))
    density = multivariate_normal(DESIGN @ values, v).logpdf(problem.observed)
    assert result.log_likelihood == pytest.approx(density)
    profiled = add_profile_intervals(problem, result)
    np.testing.assert_allclose(
        profiled["a"].interval_95, result["a"].interval_95, atol=1e-4 * result["a"].sd
    )


@pytest.mark.parametrize("kind", ["scale", "sd"])
def test_the_noise_moves_its_own_part_only(kind):
    problem = with_errors(scaled_line() if kind == "scale" else scattered_line())
    result = fit_least_squares(problem)
    noise = result[f"noise.{kind}"].value
    v = covariance_of(problem, **{kind: noise})
    values, covariance = line_by_algebra(problem, v)
    np.testing.assert_allclose(result.values[:2], values, rtol=1e-7)
    np.testing.assert_allclose(result.covariance[:2, :2], covariance, rtol=1e-7)
    left = problem.observed - DESIGN @ values
    assert left @ np.linalg.solve(v, left) == pytest.approx(result.dof)


@pytest.mark.parametrize("made", [line_problem, scaled_line, scattered_line])
@pytest.mark.parametrize("kept", [(0, 1), (0,), (1,)])
def test_the_posterior_is_that_of_the_covariance(made, kept):
    problem = with_errors(made())
    problem = replace(problem, error_sources=tuple(problem.error_sources[i] for i in kept))
    rng = np.random.default_rng(5)
    walkers = problem.parameters.pack() + rng.uniform(0.0, 0.3, (7, len(problem.free_names)))
    found = log_probability(problem)(walkers)
    expected = []
    for row in walkers:
        noise = {problem.noise_name.rpartition(".")[2]: row[2]} if problem.noise_name else {}
        v = covariance_of(problem, **noise)
        value = multivariate_normal(DESIGN @ row[:2], v).logpdf(problem.observed)
        # The prior of a scale is flat in its logarithm.
        expected.append(value - (np.log(row[2]) if "scale" in noise else 0.0))
    np.testing.assert_allclose(np.diff(found), np.diff(expected), rtol=1e-8, atol=1e-8)


def test_held_out_points_are_judged_given_the_training_points():
    """The density is the Gaussian's own conditional one, with a flat prior on the line."""
    problem = with_errors(line_problem())
    test, train = np.arange(2, 25, 6), np.setdiff1d(np.arange(25), np.arange(2, 25, 6))
    result = fit_least_squares(problem.subset(train))
    density, left = predictive_density(problem.subset(test), problem.subset(train), result)
    wide = covariance_of(problem) + 1e4 * DESIGN @ DESIGN.T
    weight = wide[np.ix_(test, train)] @ np.linalg.inv(wide[np.ix_(train, train)])
    mean = weight @ problem.observed[train]
    variance = wide[np.ix_(test, test)] - weight @ wide[np.ix_(train, test)]
    np.testing.assert_allclose(left, problem.observed[test] - mean, atol=1e-5)
    sd = np.sqrt(np.diag(variance))
    np.testing.assert_allclose(
        density, -0.5 * (left / sd) ** 2 - np.log(sd * np.sqrt(2 * np.pi)), atol=1e-4
    )
    assert compare([problem]).scores[0].parameters == 2


def test_gain_is_the_derivative_of_the_answer():
    problem = replace(calibrated_line(), error_sources=with_errors(line_problem()).error_sources)
    result = fit_least_squares(problem)
    way = propagate(problem, result)
    assert way is not None
    gain = np.hstack([way.changes(np.eye(25)), way.gain[:, 25:]])
    assert gain.shape == (4, 25 + 2)
    for point in (0, 13):
        step = 1e-3 * np.eye(25)[point]
        above, below = (
            fit_least_squares(replace(problem, observed=problem.observed + side * step)).values
            for side in (1.0, -1.0)
        )
        np.testing.assert_allclose(gain[:, point], (above - below) / 2e-3, rtol=1e-3, atol=1e-5)
    # All gains together make the covariance.
    v = covariance_of(problem)
    whole = gain[:, :25] @ v @ gain[:, :25].T + gain[:, 25:] @ gain[:, 25:].T
    np.testing.assert_allclose(whole, result.covariance, rtol=1e-6, atol=1e-15)


def spoiled_line(seed: int, size: float, draws: int, sd: float = 0.2) -> tuple[Problem, Array]:
    """Return a line of 48 points, four of them 5 to 15 errors off, and which those are.

    Twelve draws are those of stays of four points each, four those of references, each under
    ratios at all distances.
    """
    rng = np.random.default_rng([5, seed])
    near = np.arange(48) // (48 // draws)
    x = np.linspace(0.0, 1.0, 12)[np.arange(48) // 4 if draws == 12 else np.arange(48) % 12]
    columns = size * np.eye(draws)[near]
    observed = 1.0 + 2.0 * x + sd * rng.standard_normal(48) + columns @ rng.standard_normal(draws)
    bad = rng.choice(48, 4, replace=False)
    observed[bad] += rng.choice([-1.0, 1.0], 4) * rng.uniform(5.0, 15.0, 4) * sd
    parameters = {"a": free("a", 0.5), "b": free("b", 0.5)}
    problem = function_problem(
        "line", parameters, lambda v: v[0] + v[1] * x, observed, np.full(48, sd)
    )
    return replace(problem, error_sources=(source(columns, scaled=draws == 4),)), bad


@pytest.mark.parametrize("size", [0.2, 1.0])
@pytest.mark.parametrize("draws", [12, 4])
def test_a_robust_loss_holds_the_truth_where_points_share_errors(size, draws):
    one, two = np.zeros(2), np.zeros(2)
    for seed in range(200):
        result = fit_least_squares(spoiled_line(seed, size, draws)[0], loss="huber")
        for place, (name, truth) in enumerate((("a", 1.0), ("b", 2.0))):
            low, high = result[name].interval_68
            one[place] += low <= truth <= high
            low, high = result[name].interval_95
            two[place] += low <= truth <= high
    # 99.9 % of binomial counts of 200 at 68.3 % and at 95 %.
    assert np.all((one >= 114) & (one <= 158)), one
    assert np.all(two >= 179), two
