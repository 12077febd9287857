"""What a fit is said to suffer from, and what it is not accused of."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import fdtrc, stdtr

from benchtool.fit.diagnose import _hint, diagnose, lack_of_fit, with_diagnosis
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.model_problem import function_problem, noise_parameter, problem_from_model
from benchtool.fit.problem import Problem
from benchtool.fit.statistics import bend_along, runs_along, trend_along
from benchtool.physics.catalogue import EFFECTS
from benchtool.physics.model import Model
from tests.unit.fit.cases import (
    free,
    line_problem,
    noise,
    quad_conditions,
    quad_model,
    quad_problem,
    quad_thrust,
    scaled_line,
)


def sweep(model: Model, distances: tuple[float, ...], seed: int = 1) -> Problem:
    """State the fit of a model to a simulated sweep of the true quadrotor."""
    conditions = quad_conditions(distances, speeds=8)
    truth = quad_thrust(quad_model(), conditions)
    observed = truth + 0.05 * np.random.default_rng(seed).standard_normal(len(truth))
    return problem_from_model(model, conditions, observed, np.full(len(truth), 0.05))


def sentences(problem: Problem) -> str:
    """Fit by least squares and say what is wrong."""
    return "\n".join(diagnose(problem, fit_least_squares(problem)).sentences)


def test_a_good_fit_is_left_in_peace():
    problem = quad_problem()
    found = diagnose(problem, fit_least_squares(problem))
    assert found.verdict == "consistent"
    assert found.sentences == ()


def test_one_distance_cannot_tell_radius_body_lift_and_offset_apart():
    model = quad_model().with_effect("plate_offset").with_free("plate_offset.dz_m")
    problem = sweep(model, (1.0,))
    said = sentences(problem)
    names = said.partition(" cannot be separated by these data")[0].replace(" and ", ", ")
    assert set(names.split(", ")) == {"k", "R_m", "body_lift.K_b", "plate_offset.dz_m"}
    assert said.count("determine only 1 combination of these 4; fix 3") == 1


def test_a_parameter_that_does_nothing_is_named():
    model = quad_model().with_effect("load_cell_drift").with_free("load_cell_drift.rate_N_per_s")
    said = sentences(sweep(model, (0.5, 1.0, 2.0, 4.0)))
    assert "do not determine load_cell_drift.rate_N_per_s" in said
    without = sweep(quad_model(), (0.5, 1.0, 2.0))
    without = replace(without, missing=lambda column: [EFFECTS["load_cell_drift"]])
    assert _hint(without, "z").startswith("fit a model with load_cell_drift (see ")


def test_a_model_without_its_body_lift_is_rejected():
    model = quad_model().without("body_lift")
    problem = sweep(model, (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0, 8.0))
    result = with_diagnosis(problem, fit_least_squares(problem))
    assert result.facts["verdict"] == "rejected"
    assert result.chi2_per_dof > 10.0
    assert any("z_over_R" in text for text in result.warnings)


def test_a_free_scale_takes_up_some_scatter_but_not_a_missing_effect():
    problem = scaled_line()
    found = diagnose(problem, fit_least_squares(problem))
    assert found.verdict == "scatter"
    assert "too narrow" in found.sentences[0]
    wider = replace(problem, standard_error=1.5 * problem.standard_error)
    little = diagnose(wider, fit_least_squares(wider))
    assert little.verdict == "scatter"
    assert "too narrow" not in little.sentences[0]
    narrow = replace(problem, standard_error=problem.standard_error / 2.0)
    assert diagnose(narrow, fit_least_squares(narrow)).verdict == "rejected"
    unknown = replace(problem, standard_error=np.ones(len(problem)))
    assert diagnose(unknown, fit_least_squares(unknown)).verdict == "no_verdict"


def repeated_line(scatter: float, bend: float) -> Problem:
    """State a line with a free scale of errors 0.2, five settings five times each."""
    x = np.repeat(np.linspace(0.0, 1.0, 5), 5)
    observed = 1.0 + 2.0 * x + bend * (2.0 * x - 1.0) ** 2 + 0.2 * scatter * noise(4)
    parameters = {"a": free("a", 0.5), "b": free("b", 0.5), "noise.scale": noise_parameter()}
    return function_problem(
        "line", parameters, lambda v: v[0] + v[1] * x, observed, np.full(25, 0.2),
        groups=np.repeat(np.arange(5), 5),
    )  # fmt: skip


def test_settings_that_miss_more_than_repeats_scatter_reject_a_model():
    """The F test of a straight line against a mean for every setting, as textbooks have it."""
    problem = repeated_line(scatter=1.0, bend=1.4)
    result = fit_least_squares(problem)
    means = problem.observed.reshape(5, 5).mean(axis=1)
    own = np.sum((problem.observed.reshape(5, 5) - means[:, None]) ** 2) / 20.0
    line = np.polyval(np.polyfit(np.arange(5.0), means, 1), np.arange(5.0))
    ratio = 5.0 * np.sum((means - line) ** 2) / 3.0 / max(own, 0.2**2)
    lack = lack_of_fit(problem, result)
    assert lack.size == pytest.approx(ratio**0.5, rel=1e-4)
    assert lack.chance == pytest.approx(fdtrc(3, 20, ratio), rel=1e-3)
    assert 2.0 < result.chi2_per_dof < 16.0
    found = diagnose(problem, result)
    assert found.verdict == "rejected"
    assert f"misfit is {lack.size:.2g} times the scatter of repeats" in found.sentences[0]
    # As large a chi2 of repeats themselves is scatter, and so it is where no setting is repeated.
    scattered = repeated_line(scatter=3.0, bend=0.0)
    assert diagnose(scattered, fit_least_squares(scattered)).verdict == "scatter"
    single = replace(problem, groups=np.arange(25))
    assert lack_of_fit(single, result).size == 0.0
    assert diagnose(single, result).verdict == "scatter"


def test_outliers_are_named_and_others_are_not():
    problem = line_problem()
    observed = problem.observed.copy()
    observed[6] += 2.0
    labels = tuple(f"visit {i}" for i in range(len(problem)))
    spoilt = replace(problem, observed=observed, labels=labels)
    found = diagnose(spoilt, fit_least_squares(spoilt))
    assert found.outliers == (6,)
    assert "outliers: 1 of 25 points (visit 6: +" in "\n".join(found.sentences)


def test_runs_are_counted_as_by_hand():
    rows = np.array([1.0, 2.0, -1.0, -1.0, -2.0, 1.0, 1.0, -1.0])
    found = runs_along(np.arange(8.0), rows)
    assert (found.size, found.expected) == (4, 5.0)
    curved = runs_along(np.arange(40.0), np.cos(np.linspace(0.0, np.pi, 40)))
    assert curved.size == 2
    assert curved.chance < 1e-6
    # Repeats at one value count once, by their mean.
    repeated = runs_along(np.repeat(np.arange(8.0), 5), np.repeat(rows, 5))
    assert repeated.size == 4
    assert runs_along(np.arange(4.0), np.ones(4)).chance == 1.0


def test_a_bend_is_the_last_coefficient_of_a_parabola_with_students_chance():
    rng = np.random.default_rng(5)
    x = np.linspace(2.0, 6.0, 14)
    rows = 0.4 * (x - 4.0) ** 2 + rng.standard_normal(14)
    coefficients, covariance = np.polyfit((x - 4.0) / 2.0, rows, 2, cov=True)
    bend = bend_along(x, rows)
    assert bend.size == pytest.approx(coefficients[0])
    t = coefficients[0] / np.sqrt(covariance[0, 0])
    assert bend.chance == pytest.approx(2.0 * stdtr(11, -abs(t)), rel=1e-6)
    # A U in ten points is seen, which no count of runs can see; noise alone is told as it should.
    u = (np.arange(10.0) - 4.5) ** 2 - 8.25 + 0.5 * rng.standard_normal(10)
    assert bend_along(np.arange(10.0), u).chance < 1e-6
    assert runs_along(np.arange(10.0), u).chance > 1e-3
    noise = [bend_along(x, rng.standard_normal(14)).chance for _ in range(2000)]
    assert np.mean(np.array(noise) < 0.05) == pytest.approx(0.05, abs=0.015)
    assert bend_along(np.repeat([1.0, 2.0, 3.0], 4), np.tile([1.0, -1.0], 6)).chance == 1.0


def test_rank_correlation_follows_ranks_not_values():
    x = np.linspace(0.0, 3.0, 20)
    assert trend_along(x, np.exp(x)).size == pytest.approx(1.0)
    assert trend_along(x, np.exp(x)).chance < 1e-6
    ties = trend_along(np.array([1.0, 1, 2, 2, 3, 3]), np.array([1.0, 2, 3, 4, 5, 6]))
    assert ties.size == pytest.approx(0.9561828874675149)  # by hand, mid-ranks
    assert trend_along(np.ones(9), x[:9]).chance == 1.0


LOW, HIGH = np.array([-1.0, -np.inf]), np.array([1.0, np.inf])


@pytest.mark.parametrize("loss", ["soft_l1", "huber"])
def test_a_robust_fit_is_judged_without_what_it_counts_less(loss):
    rng = np.random.default_rng(3)
    rejected = spoiled = 0
    for _ in range(60):
        problem = line_problem(int(rng.integers(1 << 30)))
        rejected += diagnose(problem, fit_least_squares(problem, loss=loss)).verdict == "rejected"
        observed = problem.observed.copy()
        observed[rng.choice(25, 2, replace=False)] += 3.0  # 15 standard errors
        wild = replace(problem, observed=observed)
        found = diagnose(wild, fit_least_squares(wild, loss=loss))
        assert len(found.outliers) >= 2
        spoiled += found.verdict == "rejected"
        assert diagnose(wild, fit_least_squares(wild)).verdict == "rejected"
    assert rejected <= 1  # 0.001 of 60, 99.8 % limit
    assert spoiled <= 2  # 8 % of the points far out move a median a little
