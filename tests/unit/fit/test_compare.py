"""Models compared on points that they were not fitted to."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchtool.core.errors import InputError
from benchtool.core.rig_file import load_rig_by_name
from benchtool.fit.compare import compare, predictive_density
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.model_problem import problem_from_model
from benchtool.fit.problem import Problem
from benchtool.physics.model import Model
from tests.unit.fit.cases import X, line_problem, quad_conditions, quad_thrust
from tests.unit.fit.cases import quad_model as with_body_lift

SIGMA_N = 0.3


def candidates(truth: Model, seed: int = 1) -> list[Problem]:
    """State single, quad and quad with body lift on one simulated sweep of the truth."""
    conditions = quad_conditions((0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0), speeds=6)
    observed = quad_thrust(truth, conditions)
    observed += SIGMA_N * np.random.default_rng(seed).standard_normal(len(observed))
    single = Model.single(load_rig_by_name("pquad"), "single").with_free("k", "R_m")
    quad = replace(single.with_effect("neighbour_images"), name="quad")
    full = replace(with_body_lift(), name="quad_body_lift")
    return [
        problem_from_model(model, conditions, observed, np.full(len(observed), SIGMA_N))
        for model in (single, quad, full)
    ]


def test_the_true_model_foretells_best():
    found = compare(candidates(with_body_lift()))
    assert found.scores[0].model == "quad_body_lift"
    assert found.settings == 8
    assert {score.model for score in found.scores[1:]} == {"single", "quad"}
    assert all(score.is_clearly_behind for score in found.scores[1:])
    best = found.scores[0]
    assert SIGMA_N < best.held_out_rms < 0.5 * min(s.held_out_rms for s in found.scores[1:])
    assert best.behind_best == 0.0
    assert best.aic == min(score.aic for score in found.scores)


def test_criteria_are_those_of_the_book():
    problem = line_problem()
    score = compare([problem]).scores[0]
    design = np.stack([np.ones(25), X], axis=1)
    left = problem.observed - design @ np.linalg.lstsq(design, problem.observed)[0]
    log_likelihood = np.sum(-0.5 * (left / 0.2) ** 2) - 25 * np.log(0.2 * np.sqrt(2 * np.pi))
    assert score.aic == pytest.approx(4 - 2 * log_likelihood)
    assert score.bic == pytest.approx(2 * np.log(25) - 2 * log_likelihood)
    assert score.chi2_per_dof == pytest.approx(np.sum((left / 0.2) ** 2) / 23)


def test_a_foretold_density_carries_the_uncertainty_of_the_fit():
    problem = line_problem()
    train, test = problem.subset(np.arange(10)), problem.subset(np.array([24]))
    result = fit_least_squares(train)
    density, left = predictive_density(test, train, result)
    row = np.array([1.0, X[24]])
    variance = 0.04 + row @ result.covariance @ row
    expected = -0.5 * left[0] ** 2 / variance - 0.5 * np.log(2 * np.pi * variance)
    assert density[0] == pytest.approx(expected)
    assert left[0] == pytest.approx(problem.observed[24] - row @ result.values)


def test_what_cannot_be_compared_is_refused():
    problem = line_problem()
    with pytest.raises(InputError, match="no model to compare"):
        compare([])
    with pytest.raises(InputError, match="have different points"):
        compare([problem, replace(problem, observed=problem.observed + 1.0)])
    with pytest.raises(InputError, match="2 settings are too few for cross-validation; minimum: 3"):
        compare([replace(problem, groups=np.arange(25) % 2)])
