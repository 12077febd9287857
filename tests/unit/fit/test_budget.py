"""Uncertainty budgets against closed forms, worked examples of the GUM, and Monte Carlo."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchtool.core.air import Air, air_density_kg_m3
from benchtool.core.error_source import ErrorSource, effective_dof
from benchtool.core.parameter import Prior
from benchtool.core.units import Array
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.model_problem import function_problem
from benchtool.fit.problem import Problem
from benchtool.fit.recipe import Recipe
from benchtool.fit.run_recipe import run_recipe
from benchtool.fit.uncertainty.budget import MonteCarlo
from benchtool.fit.uncertainty.fixed_parameters import fixed_parameter_sources
from benchtool.fit.uncertainty.propagation import (
    Propagation,
    bound_sources,
    draw_source,
    make_budget,
    propagate,
    with_derived,
)
from benchtool.physics.conditions import Conditions
from benchtool.physics.effects.effect import Derived
from benchtool.physics.model import Model
from tests.unit.fit.cases import (
    X,
    calibrated_line,
    decay_problem,
    free,
    line_problem,
    quad_model,
    scaled_line,
)


def carried(problem: Problem, *derived: Derived) -> Propagation:
    way = propagate(problem, with_derived(fit_least_squares(problem), derived), derived)
    assert way is not None
    return way


def shared(m: int, sd: float = 0.1, **more: object) -> ErrorSource:
    facts = {"name": "zero", "kind": "B", "unit": "1", "sd": sd, "columns": np.full((m, 1), sd)}
    return ErrorSource(**{**facts, **more})  # type: ignore[arg-type]


def weighted_mean(*sources: ErrorSource) -> Problem:
    def mean(values: object) -> object:
        return values[0] + np.zeros(3)  # type: ignore[index]

    return function_problem(
        "mean", {"mu": free("mu", 0.0)}, mean, np.array([1.0, 1.2, 0.9]),
        np.array([0.1, 0.2, 0.3]), error_sources=sources,
    )  # fmt: skip


def test_a_weighted_mean_with_a_common_zero():
    """Its variance is 1 / sum of weights, and the zero's beside it."""
    budget = make_budget(carried(weighted_mean(shared(3))))
    repeat, zero = budget.lines
    weights = 1.0 / np.array([0.1, 0.2, 0.3]) ** 2
    assert repeat.contribution[0] == pytest.approx(weights.sum() ** -0.5)
    assert (zero.contribution[0], zero.sensitivity[0]) == pytest.approx((0.1, 1.0))
    assert budget.combined[0] == pytest.approx(np.hypot(weights.sum() ** -0.5, 0.1))
    assert budget.combined[0] == pytest.approx(budget.fit_sd[0])
    # The same source outside of the fit adds the same, and the fit does not know it.
    outside = make_budget(replace(carried(weighted_mean()), outside=(shared(3),)))
    assert outside.combined == pytest.approx(budget.combined)
    assert outside.fit_sd[0] == pytest.approx(weights.sum() ** -0.5)
    assert [line.in_fit for line in outside.lines] == [True, False]


def test_the_thermometer_of_the_gum():
    """JCGM 100:2008, H.3: corrections b = y1 + y2 (t - 20) and that at 30 degC."""
    t = np.array(
        [21.521, 22.012, 22.512, 23.003, 23.507, 23.999, 24.513, 25.002, 25.503, 26.010, 26.511]
    )
    b = -1e-3 * np.array([171, 169, 166, 159, 164, 165, 156, 157, 159, 161, 160])
    problem = function_problem(
        "thermometer",
        {"y1": free("y1", 0.0), "y2": free("y2", 0.0)},
        lambda v: v[0] + v[1] * (t - 20.0),
        b,
    )
    budget = make_budget(carried(problem, Derived("b_30", "1", lambda v: v["y1"] + 10 * v["y2"])))
    assert budget.values == pytest.approx((-0.1712, 0.00218, -0.1494), abs=6e-5)
    assert budget.combined == pytest.approx((0.0029, 0.00067, 0.0041), rel=0.02)
    assert budget.correlation[0][1] == pytest.approx(-0.930, abs=5e-4)
    assert budget.dof == pytest.approx((9.0, 9.0, 9.0))
    assert budget.coverage_factor[0] == pytest.approx(2.262, abs=5e-4)


def test_the_end_gauge_of_the_gum():
    """JCGM 100:2008, H.1.6: 16 degrees of freedom of a combined 32 nm."""
    parts, dof = np.array([25.0, 9.7, 2.9, 16.6]), np.array([18.0, 25.6, 50.0, 2.0])
    assert np.linalg.norm(parts) == pytest.approx(32.0, abs=0.4)
    assert int(effective_dof(parts, dof)) == 16
    assert effective_dof(parts, np.full(4, np.inf)) == np.inf


def test_sources_of_one_scatter_have_its_degrees_of_freedom():
    """Equal sources whose variance is one estimate of 6 degrees of freedom have 6, not 12."""
    parts, dof = np.full(2, 3.0), np.full(2, 6.0)
    assert effective_dof(parts, dof, ["", ""]) == pytest.approx(12.0)
    assert effective_dof(parts, dof, ["cells", "cells"]) == pytest.approx(6.0)
    # With something exactly known beside them: (2 x 9 + 7)^2 / (18^2 / 6).
    known = effective_dof(
        np.array([3.0, 3.0, 7.0**0.5]), np.array([6.0, 6.0, np.inf]), ["c"] * 2 + [""]
    )
    assert known == pytest.approx(25.0**2 * 6.0 / 18.0**2)


@pytest.mark.parametrize("make", [line_problem, scaled_line, decay_problem, calibrated_line])
def test_sources_of_a_fit_make_its_covariance(make):
    problem = make()
    m = len(problem)
    steps = np.zeros((m, 2))
    steps[: m // 2, 0] = steps[m // 2 :, 1] = 0.07
    problem = replace(
        problem, error_sources=(shared(m), shared(m, name="stays", columns=steps, scaled=True))
    )
    result = fit_least_squares(problem)
    way = propagate(problem, result)
    assert way is not None
    budget = make_budget(way)
    assert budget.combined == pytest.approx(budget.fit_sd, rel=1e-6)
    place = problem.shape_index
    covariance = result.covariance[np.ix_(place, place)]
    sd = np.sqrt(np.diag(covariance))
    assert np.array(budget.correlation) == pytest.approx(covariance / np.outer(sd, sd), abs=1e-6)


def test_a_rejected_model_has_its_errors_scaled_in_the_budget(tmp_path):
    """By the root of chi2/dof, in a row of its own: the fit's own error stays as stated."""
    rpm = np.linspace(3000.0, 6000.0, 12)
    thrust_N = 1.1e-7 * rpm**2 * (1.0 + 0.05 * (-1.0) ** np.arange(12))
    rows = [f"{a},{b},0.01" for a, b in zip(rpm, thrust_N, strict=True)]
    (tmp_path / "far.csv").write_text("\n".join(["rpm1,thrust_N,thrust_se_N", *rows]))
    recipe = Recipe(
        name="far", data=(str(tmp_path / "far.csv"),), model="single", rig="pquad_single",
        hold=("R_m",),
    )  # fmt: skip
    output = run_recipe(recipe)
    (result,), budget = output.results, output.budget
    assert budget is not None
    assert result.facts["verdict"] == "rejected"
    place = budget.names.index("k")
    (line,) = (one for one in budget.lines if one.name == "misfit")
    scaled = np.hypot(line.contribution[place], result["k"].sd)
    assert scaled == pytest.approx(result["k"].sd * result.chi2_per_dof**0.5, rel=1e-3)
    assert (line.kind, line.dof, line.in_fit) == ("A", 11.0, False)
    assert f"{result.chi2_per_dof**0.5:.3g}" in line.origin
    assert result["k"].combined_sd >= scaled
    # A scale that the fit has free holds it already.
    free_scale = run_recipe(replace(recipe, noise="scale")).budget
    assert free_scale is not None
    assert "misfit" not in {one.name for one in free_scale.lines}


def test_an_open_parameter_has_no_budget():
    problem = function_problem(
        "sum",
        {"a": free("a", 0.0), "b": free("b", 0.0)},
        lambda v: v[0] + v[1] + 0.0 * X,
        X,
        np.ones(len(X)),
    )
    assert propagate(problem, fit_least_squares(problem)) is None


@pytest.mark.parametrize(
    ("distribution", "dof", "ends"),
    [
        ("normal", np.inf, 1.95996),
        ("uniform", np.inf, 0.95 * 3.0**0.5),
        ("triangular", np.inf, 6.0**0.5 * (1.0 - 0.05**0.5)),
        ("student_t", 4.0, 2.77645),
    ],
)
def test_monte_carlo_draws_each_distribution(distribution, dof, ends):
    """Ends of the central 95 % of each, and its standard deviation (JCGM 101, 6.4)."""
    source, rng = shared(1, distribution=distribution, dof=dof), np.random.default_rng(1)
    found = np.concatenate([draw_source(source, rng) for _ in range(40_000)])
    assert np.quantile(found, [0.025, 0.975]) == pytest.approx((-ends, ends), rel=0.03)
    if dof == np.inf:
        assert found.std() == pytest.approx(1.0, rel=0.02)


@pytest.mark.parametrize(("share", "factor"), [(0.5, 1.952), (0.7, 1.919), (0.9, 1.804)])
def test_a_uniform_source_and_normal_ones_have_the_factor_of_their_sum(share, factor):
    """Against 95 % quantiles of a million drawn sums."""
    rest = (np.array([0.1, 0.2, 0.3]) ** -2.0).sum() ** -0.5
    source = shared(3, share / (1.0 - share**2) ** 0.5 * rest, distribution="uniform")
    budget = make_budget(replace(carried(weighted_mean()), outside=(source,)))
    assert budget.coverage_factor[0] == pytest.approx(factor, abs=2e-3)
    # Many draws of their own add to a normal distribution.
    drawn_apart = replace(source, columns=np.diag(source.columns[:, 0]))
    apart = make_budget(replace(carried(weighted_mean()), outside=(drawn_apart,)))
    assert apart.coverage_factor[0] == pytest.approx(1.95996, abs=1e-4)


def stepped(levels: Array) -> Problem:
    """Return the mean of twelve readings of errors 0.1 about levels (12,)."""

    def mean(values: object) -> object:
        return values[0] + np.zeros(12)  # type: ignore[index]

    noise = 0.1 * np.random.default_rng(5).standard_normal(12)
    return function_problem(
        "mean", {"mu": free("mu", 0.0)}, mean, noise + levels, np.full(12, 0.1)
    )  # fmt: skip


def test_a_source_that_the_residuals_exclude_is_entered_at_their_bound():
    pattern = np.where(np.arange(12) < 4, 1.0, 0.0)
    source = shared(12, 2.0, name="step", columns=2.0 * pattern[:, None], distribution="uniform")
    own = 0.1 / (4.0 - 16.0 / 12.0) ** 0.5  # sd of the step that the residuals leave
    for true in (0.0, 0.3):
        way = carried(stepped(true * pattern))
        (found,) = bound_sources(way, [source])
        assert found.kind == "A"
        residuals = way.problem.observed - way.shape[0]
        step = residuals @ (pattern - pattern.mean()) / (4.0 - 16.0 / 12.0)
        scale = max(float(residuals @ residuals) / 0.1**2 / 11.0, 1.0) ** 0.5  # root of chi2/dof
        assert found.sd == pytest.approx(np.hypot(step, scale * own), rel=1e-3)
        assert found.columns == pytest.approx(found.sd * pattern[:, None])
        assert "residuals of this run" in found.origin


def test_a_source_that_the_residuals_do_not_show_is_entered_as_stated():
    """A common zero is the mean, and of two sources of one pattern each may hide the other."""
    way = carried(stepped(np.zeros(12)))
    zero = shared(12, 2.0, distribution="uniform")
    assert bound_sources(way, [zero]) == (zero,)
    pattern = np.where(np.arange(12) < 4, 2.0, 0.0)[:, None]
    twins = [shared(12, 2.0, name=name, columns=pattern) for name in ("tilt", "loop")]
    assert bound_sources(way, twins) == tuple(twins)
    assert bound_sources(way, [twins[0], zero])[0].sd < 0.2
    assert bound_sources(way, []) == ()


def level_bench(model: Model) -> Conditions:
    speeds = np.tile([400.0, 600.0], (model.rig.n_rotors, 4))
    z = np.repeat([0.07, 0.12, 0.3, 1e6], 2)
    return Conditions.build(model.rig, speed_rad_s=speeds, plate_z_m=z, load_direction=1.0)


def test_what_a_model_holds_counts_by_its_prior_or_tolerance():
    model = quad_model().with_fixed("k")
    sources = {one.name: one for one in fixed_parameter_sources(model, level_bench(model))}
    tare = sources["tare_offset.thrust_N"]
    assert tare.columns[:, 0] == pytest.approx(np.full(8, tare.sd))
    assert tare.distribution == "uniform"
    assert tare.origin == f"assumed by benchtool: 0 ± {tare.sd * 3**0.5:g}"
    law = sources["law of body_lift"].columns[:, 0]
    assert law[-1] == pytest.approx(0.0, abs=1e-9)
    assert law[0] > 0.0
    # k is fixed, and nobody says how well it is known; R and K_b are fitted.
    assert not {"k", "R_m", "body_lift.K_b"} & set(sources)
    known = model.parameters["k"]
    stated = model.with_values(
        model.parameters.with_replaced(
            "k", replace(known, prior=Prior("normal", known.value, 0.01 * known.value, "sheet"))
        )
    )
    by_prior = {one.name: one for one in fixed_parameter_sources(stated, level_bench(model))}["k"]
    thrust = model.thrust_N(level_bench(model))
    assert by_prior.columns[:, 0] == pytest.approx(0.01 * thrust)
    assert (by_prior.origin, by_prior.distribution) == ("sheet", "normal")


def test_k_is_given_at_the_standard_density_as_well(tmp_path):
    """At the density that was stated, with what that density leaves open (CIPM-2007)."""
    table = "rpm1,thrust_N,thrust_se_N\n4000,1.81,0.01\n5000,2.83,0.01\n6000,4.08,0.01\n"
    (tmp_path / "far.csv").write_text(table)
    recipe = Recipe(
        name="far", data=(str(tmp_path / "far.csv"),), model="single", rig="pquad_single",
        hold=("R_m",), air=Air(temperature=30.0, pressure=900.0, humidity=50.0),
    )  # fmt: skip
    output = run_recipe(recipe)
    density = air_density_kg_m3(30.0, 90_000.0, 0.5)
    k, standard = (output.results[0][name] for name in ("k", "k_standard_air"))
    assert standard.value == pytest.approx(k.value * 1.225 / density)
    budget = output.budget
    assert budget is not None
    place = budget.names.index("k_standard_air")
    air = next(line for line in budget.lines if line.name == "air density")
    assert air.sensitivity[place] == pytest.approx(-standard.value / density)
    assert air.contribution[budget.names.index("k")] == 0.0
    # 1 K of 303 with 5.7 % more vapour, 2 hPa of 900, a fifth of 42.5 hPa of vapour; uniform.
    vapour = 0.378 * 42.47 / 900.0
    parts = [1.0 / 303.15 + 0.5 * 0.057 * vapour, 2.0 / 900.0, 0.2 * vapour]
    assert air.sd / density == pytest.approx(np.linalg.norm(parts) / 3.0**0.5, rel=0.02)
    assert air.origin.startswith("stated: 30 degC, 900 hPa, 50 %")
    bare = run_recipe(replace(recipe, air=Air()))
    assert bare.budget is not None
    assert "k_standard_air" not in bare.budget.names


ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def quad():
    recipe = Recipe(name="quad", data=(str(ROOT / "datasets/quad/run"),), model="quad_bench")
    return run_recipe(replace(recipe, methods=("least_squares", "emcee")))


def test_a_posterior_has_the_sources_outside_of_it_as_well(quad):
    budget, (first, other) = quad.budget, (one["K_b"] for one in quad.results)
    assert budget is not None
    place = budget.names.index("body_lift.K_b")
    held = np.linalg.norm([one.contribution[place] for one in budget.lines if not one.in_fit])
    assert other.combined_sd == pytest.approx(np.hypot(other.sd, held))
    assert other.combined_95 == pytest.approx(first.combined_95, abs=0.2 * first.sd)


def test_monte_carlo_goes_before_a_propagation_that_it_refutes():
    way = carried(weighted_mean())
    drawn = MonteCarlo(draws=2000, seed=1, sd=(0.1,), low=(-0.1,), high=(0.3,))
    budget = replace(make_budget(way), monte_carlo=drawn)
    assert budget.confirmed == (False,)
    item = budget.add_combined(way.items[0], first=True)
    assert np.array(item.combined_95) - item.value == pytest.approx((-0.1, 0.3))
    assert item.combined_sd == 0.1
