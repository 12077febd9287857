"""The problem: what it refuses, how it varies, and what it makes of a model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchtool.core.errors import InputError
from benchtool.core.parameter import Prior
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.model_problem import function_problem, problem_from_model
from benchtool.physics.bases import ground_effect_ratio
from tests.unit.fit.cases import (
    QUAD_TRUTH,
    free,
    line,
    line_problem,
    quad_conditions,
    quad_model,
    quad_problem,
    quad_thrust,
    scaled_line,
    scattered_line,
)


def test_points_without_a_usable_error_are_named():
    problem = line_problem()
    errors = problem.standard_error.copy()
    errors[4] = 0.0
    with pytest.raises(InputError, match=r"standard error of point 5 is 0; allowed: above 0"):
        replace(problem, standard_error=errors)
    observed = problem.observed.copy()
    observed[2] = np.nan
    with pytest.raises(InputError, match="observation of point 3 is nan"):
        replace(problem, observed=observed)


def test_lengths_must_agree_and_something_must_be_free():
    problem = line_problem()
    with pytest.raises(InputError, match="25 points were observed, but groups has 3"):
        replace(problem, groups=np.arange(3))
    with pytest.raises(InputError, match="no free parameter that changes its prediction"):
        function_problem("line", {"a": free("a", 1.0).as_fixed()}, line, problem.observed)


def test_two_free_noise_parameters_are_refused():
    both = {**dict(scaled_line().parameters), **dict(scattered_line().parameters)}
    with pytest.raises(InputError, match="both free"):
        function_problem("line", both, line, line_problem().observed, np.ones(25))


def test_sigma_scales_and_adds_in_quadrature():
    np.testing.assert_allclose(scaled_line().sigma(3.0), 0.6)
    np.testing.assert_allclose(scattered_line().sigma(0.3), np.hypot(0.2, 0.3))
    fixed = scattered_line().fixed("noise.sd", 0.15)
    np.testing.assert_allclose(fixed.sigma(), 0.25)
    assert fixed.noise_name is None


def test_a_subset_predicts_its_own_points():
    problem = quad_problem()
    rows = np.array([3, 0, 20])
    part = problem.subset(rows)
    np.testing.assert_array_equal(part.observed, problem.observed[rows])
    np.testing.assert_array_equal(part.predict(part.start), problem.predict(problem.start)[rows])
    assert part.label(0) == problem.label(3)
    assert part.covariates["z_over_R"][2] == problem.covariates["z_over_R"][20]


@pytest.mark.parametrize(
    "more",
    [
        (),
        ("plate_offset.dz_m", "plate_tilt.angle_rad"),
        ("plate_offset.dz_m", "partial_coverage.share_2"),
        ("neighbour_images.strength", "tare_offset.thrust_N"),
    ],
    ids=lambda names: " ".join(names) or "level",
)
def test_a_model_predicts_what_it_predicts_by_itself(more):
    level = quad_conditions()
    coverage = np.random.default_rng(1).choice([0.0, 0.3, 1.0], level.coverage.shape)
    for conditions in (level, replace(level, coverage=coverage)):
        model = quad_model()
        for effect in ("plate_offset", "plate_tilt", "partial_coverage", "tare_offset"):
            model = model.with_effect(effect)
        model = model.with_free(*more)
        problem = problem_from_model(
            model, conditions, quad_thrust(model, conditions), np.full(len(conditions), 0.1)
        )
        values = problem.start * 1.03 + 0.001 * np.arange(len(problem.start)) * (len(more) > 0)
        own = model.with_values(model.parameters.with_values(values))
        expected = own.thrust_N(conditions)
        np.testing.assert_allclose(problem.predict(values), expected, rtol=1e-12)
        many = np.stack([problem.start, values], axis=1)[:, :, None]
        np.testing.assert_allclose(problem.predict(many)[1], expected, rtol=1e-12)


def test_a_tare_error_and_a_drift_move_a_ratio_and_its_reference():
    model = quad_model().with_effect("tare_offset").with_effect("load_cell_drift")
    model = model.with_free("tare_offset.thrust_N", "load_cell_drift.rate_N_per_s")
    near = replace(quad_conditions(), elapsed_s=np.linspace(0.0, 300.0, 35))
    parked = replace(near.out_of_ground_effect(), elapsed_s=near.elapsed_s + 20.0)
    truth = {**QUAD_TRUTH, "tare_offset.thrust_N": 0.02, "load_cell_drift.rate_N_per_s": 1e-4}
    made = model.with_values(model.parameters.with_values(np.array([*truth.values()])))
    ratio = made.thrust_N(near) / made.thrust_N(parked)
    bare = made.without("tare_offset").without("load_cell_drift")
    assert np.ptp(ratio / ground_effect_ratio(bare, "equal_rpm2", near)) > 1e-3
    at = model.with_fixed("k", QUAD_TRUTH["k"])
    problem = problem_from_model(
        at, near, ratio, np.full(35, 0.01), basis="equal_rpm2", reference=parked
    )
    result = fit_least_squares(problem)
    assert result.basis == "equal_rpm2"
    for name in problem.free_names:
        assert result[name].value == pytest.approx(truth[name], rel=1e-6)


def test_ratios_hold_the_thrust_coefficient():
    model, conditions = quad_model(), quad_conditions()
    made = model.with_values(model.parameters.with_values(np.array([*QUAD_TRUTH.values()])))
    truth = ground_effect_ratio(made, "equal_rpm2", conditions)
    problem = problem_from_model(
        model, conditions, truth, np.full(len(truth), 0.01), basis="equal_rpm2"
    )
    assert problem.facts["held"] == "k"
    result = fit_least_squares(problem)
    assert result["R_m"].value == pytest.approx(QUAD_TRUTH["R_m"], rel=1e-9)
    assert result["body_lift.K_b"].value == pytest.approx(QUAD_TRUTH["body_lift.K_b"], rel=1e-8)


def test_priors_are_met_as_algebra_has_them():
    problem = line_problem(4)
    known = zip(("a", "b"), (1.0, 2.0), (0.1, 0.05), strict=True)
    for name, mean, sd in known:
        parameter = replace(problem.parameters[name], prior=Prior("normal", mean, sd))
        problem = replace(problem, parameters=problem.parameters.with_replaced(name, parameter))
    result = fit_least_squares(problem)
    design = np.stack([np.ones(25), np.linspace(0, 1, 25)], axis=1) / 0.2
    information = np.diag([100.0, 400.0])
    precision = design.T @ design + information
    np.testing.assert_allclose(result.covariance, np.linalg.inv(precision), rtol=1e-9)
    right = design.T @ (problem.observed / 0.2) + information @ [1.0, 2.0]
    np.testing.assert_allclose(result.values, np.linalg.solve(precision, right), rtol=1e-9)
