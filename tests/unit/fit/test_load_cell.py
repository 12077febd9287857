"""Calibrations in a fit: each with its own scale, Student's t, and named for tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom, t

from benchtool.acquire.calibration import fit_calibration
from benchtool.acquire.inputs import MassUncertainty, WeighingInputs
from benchtool.core.parameter import Parameter
from benchtool.fit.ensemble import fit_ensemble
from benchtool.fit.least_squares import add_profile_intervals, fit_least_squares
from benchtool.fit.model_problem import function_problem
from benchtool.fit.problem import Problem
from benchtool.fit.recipe import read_recipe
from benchtool.fit.run_recipe import run_recipe
from benchtool.fit.uncertainty.load_cell import ScaleError, pool_calibrations, with_scale_errors
from benchtool.fit.uncertainty.propagation import make_budget, monte_carlo, propagate
from benchtool.fit.uncertainty.run_budget import run_budget
from tests.unit.fit.test_fits import CALIBRATION, FITS, copied

QUAD = replace(read_recipe(FITS / "quad"), methods=("least_squares",), compare=())
STATED = [
    {"name": "gravity", "kind": "B", "unit": "m/s2", "sd": 0.1, "relative_sd": 0.01, "dof": None}
]


def test_runs_of_different_calibrations_have_a_scale_each(tmp_path):
    """One cell 1 % high, one 2 % low, both known to 1 %: their own slopes take that up."""
    known = {**CALIBRATION, "components": STATED}
    a = copied(tmp_path / "a", 1.01, calibration={**known, "id": "cell-a"})
    b = copied(tmp_path / "b", 0.98, calibration={**known, "id": "cell-b"})
    alone = run_recipe(QUAD).results[0]["k"]
    both = run_recipe(replace(QUAD, data=(a, b))).results[0]
    scales = [both[f"calibration.scale@cell-{which}"].value for which in "ab"]
    np.testing.assert_allclose(scales[0] / scales[1], 1.01 / 0.98, rtol=3e-3)
    assert both["k"].value / alone.value == pytest.approx(0.995, abs=2e-3)
    assert both["k"].sd / both["k"].value == pytest.approx(0.01 / np.sqrt(2.0), rel=0.05)


def test_a_run_without_a_calibration_beside_one_that_has_it_is_named(tmp_path):
    other = copied(tmp_path / "o", 1.01, calibration={**CALIBRATION, "components": STATED})
    result = run_recipe(replace(QUAD, data=(*QUAD.data, other))).results[0]
    assert any("has no calibration" in text for text in result.warnings)
    assert result["calibration.scale"].value == pytest.approx(1.01, abs=2e-3)


def weighed(seed: int) -> tuple[Problem, float]:
    """Return the problem of k from 30 thrusts through a cell of five masses, and the true k."""
    rng = np.random.default_rng([5, seed])
    masses = np.array([0.0, 0.2, 0.5, 1.0, 1.5])
    counts = 8000.0 + 420.0 * 9.80665 * masses + rng.normal(0.0, 5.0, 5)
    made = fit_calibration(masses, counts, date="2026-01-31", device_id="d")
    squares = np.linspace(1.0, 8.0, 30)
    truth = rng.uniform(0.8, 1.2)
    seen = 420.0 * truth * squares * (1.0 + 1e-4 * rng.normal(size=30))
    problem = function_problem(
        "thrust",
        {"k": Parameter("k", "1", 1.0, free=True)},
        lambda values: values[0] * squares,
        made.newtons(seen, 0.0),
        1e-4 * squares,
    )
    error = ScaleError(calibration=asdict(made), rows=np.ones(30, bool))
    return with_scale_errors(problem, [error]), truth


def test_intervals_of_five_masses_hold_the_thrust_coefficient():
    """Normal intervals would hold it in 61 and 85 % (400 calibrations)."""
    held = np.zeros(2)
    for seed in range(400):
        problem, truth = weighed(seed)
        k = fit_least_squares(problem)["k"]
        held += [low <= truth <= high for low, high in (k.interval_68, k.interval_95)]
    for count, p in zip(held, (0.6827, 0.95), strict=True):
        assert binom.ppf(5e-4, 400, p) <= count <= binom.ppf(1.0 - 5e-4, 400, p), (p, count)


def competing(seed: int, cells: int, *, se: float = 1e-5) -> Problem:
    """Return the problem of a mean of 1 seen through cells of three degrees of freedom each."""
    rng = np.random.default_rng([7, seed, cells])
    problem = function_problem(
        "mean",
        {"k": Parameter("k", "1", 1.0, free=True)},
        lambda values: values[0] * np.ones(3 * cells),
        np.repeat(1.0 + 0.01 * rng.normal(size=cells), 3),
        np.full(3 * cells, se),
    )
    known: list[Mapping[str, object]] = []
    for cell, sd in enumerate(0.01 * np.sqrt(rng.chisquare(3.0, cells) / 3.0)):
        of_line = {"name": "repeat", "kind": "A", "unit": "1", "sd": sd, "relative_sd": sd}
        of_line |= {"distribution": "student_t", "dof": 3.0}
        facts = {"id": str(cell), "masses_kg": [0.0] * 5, "relative_sd": sd}
        facts |= {"residual_sd_N": sd, "components": [of_line]}
        known.append({**CALIBRATION, **facts})
    errors = [
        ScaleError(calibration=one, rows=np.arange(3 * cells) // 3 == cell)
        for cell, one in enumerate(pool_calibrations(known))
    ]
    return with_scale_errors(problem, errors)


@pytest.mark.parametrize("cells", [2, 3])
def test_cells_that_share_their_scatter_hold_what_they_state(cells):
    """With degrees of freedom as of independent estimates two held 66 and 92 %: 12 for 6."""
    held = np.zeros(2)
    for seed in range(600):
        k = fit_least_squares(competing(seed, cells))["k"]
        held += [low <= 1.0 <= high for low, high in (k.interval_68, k.interval_95)]
    for count, p in zip(held, (0.6827, 0.95), strict=True):
        assert binom.ppf(5e-4, 600, p) <= count <= binom.ppf(1.0 - 5e-4, 600, p), (p, count / 600)
    problem = competing(0, cells, se=1e-3)
    k = fit_least_squares(problem)["k"]
    for p, (low, high) in ((0.6827, k.interval_68), (0.95, k.interval_95)):
        half = t.ppf(0.5 + 0.5 * p, 3.0 * cells)
        assert (high - low) / (2.0 * k.sd) == pytest.approx(half, rel=0.01)
    # Given what the cells say of each other, Student's t of nu + cells - 1 degrees of freedom.
    nu, slopes, scatter = 3.0 * cells, problem.observed[::3], k.sd * np.sqrt(cells)
    between = float(np.sum((slopes - slopes.mean()) ** 2)) / scatter**2
    dof = nu + cells - 1.0
    expected = t.ppf(0.975, dof) * k.sd * np.sqrt((nu + between) / dof)
    low, high = fit_ensemble(problem, walkers=32, max_steps=8000, seed=3)["k"].interval_95
    assert 0.5 * (high - low) == pytest.approx(expected, rel=0.1)


def test_both_estimators_and_the_profile_give_students_t():
    problem, _ = weighed(1)
    result = fit_least_squares(problem)
    k = result["k"]
    for p, (low, high) in ((0.6827, k.interval_68), (0.95, k.interval_95)):
        assert (high - low) / (2.0 * k.sd) == pytest.approx(t.ppf(0.5 + 0.5 * p, 3.0), rel=0.01)
    profiled = add_profile_intervals(problem, result)["k"]
    np.testing.assert_allclose(profiled.interval_95, k.interval_95, rtol=2e-4)
    drawn = fit_ensemble(problem, walkers=16, max_steps=4000, seed=3)["k"]
    half = [0.5 * (high - low) for low, high in (drawn.interval_95, k.interval_95)]
    assert half[0] == pytest.approx(half[1], rel=0.2)


def test_the_budget_lists_what_the_calibration_is_made_of():
    rng = np.random.default_rng(8)
    masses = np.tile([0.0, 0.2, 0.5, 1.0, 1.5], 2)
    known = MassUncertainty(mass_scale_u=2e-3, gravity_u_m_s2=0.01)
    made = fit_calibration(
        masses, 8000.0 + 420.0 * 9.80665 * masses + rng.normal(0.0, 5.0, 10), date="2026-01-31",
        device_id="d", weighing=WeighingInputs(uncertainty=known, operator="Ada"),
    )  # fmt: skip
    problem = with_scale_errors(
        function_problem(
            "thrust",
            {"k": Parameter("k", "1", 1.0, free=True)},
            lambda values: values[0] * np.ones(9),
            np.ones(9),
            1e-4 * np.ones(9),
        ),
        [ScaleError(calibration=asdict(made), rows=np.ones(9, bool))],
    )
    way = propagate(problem, fit_least_squares(problem))
    assert way is not None
    budget = make_budget(way)
    by_name = {line.name.rpartition(": ")[2]: line for line in budget.lines}
    k = budget.names.index("k")
    for part in made.components:
        line = by_name[part.name]
        assert line.contribution[k] == pytest.approx(part.relative_sd, rel=1e-3)
        assert (line.kind, line.unit, line.sd) == (part.kind, part.unit, part.sd)
        assert "by Ada on 2026-01-31" in line.origin
    assert budget.combined[k] == pytest.approx(made.relative_sd, rel=1e-3)
    assert budget.dof[k] == pytest.approx(made.dof, rel=0.01)
    checked = monte_carlo(way, draws=2000, seed=2)
    assert checked.sd[k] == pytest.approx(made.relative_sd, rel=0.15)


def calibrated(scatter_N: float, dof: int = 3) -> dict[str, object]:
    """Return what pooling asks of a calibration."""
    repeat = {"name": "repeat", "sd": scatter_N, "relative_sd": 0.1 * scatter_N, "dof": dof}
    mass = {"name": "masses", "sd": 1e-3, "relative_sd": 3e-4, "dof": None}
    total = float(np.hypot(0.1 * scatter_N, 3e-4))
    return {"residual_sd_N": scatter_N, "relative_sd": total, "components": [repeat, mass]}


def test_a_line_that_came_out_straight_by_luck_weighs_no_more():
    found = pool_calibrations([calibrated(0.0001), calibrated(0.03), calibrated(0.04)])
    repeats = [one["components"][0] for one in found]
    assert [one["dof"] for one in repeats] == [9.0] * 3
    together = np.sqrt((0.0001**2 + 0.03**2 + 0.04**2) / 3.0)
    assert [one["relative_sd"] for one in repeats] == pytest.approx([0.1 * together] * 3)
    assert found[0]["relative_sd"] == pytest.approx(np.hypot(0.1 * together, 3e-4))
    assert found[0]["components"][1] == calibrated(0.0001)["components"][1]


def test_a_cell_that_scatters_clearly_more_keeps_its_own():
    *alike, loose = pool_calibrations(
        [calibrated(0.03, 9), calibrated(0.04, 9), calibrated(0.4, 9)]
    )
    assert loose == calibrated(0.4, 9)
    assert {one["components"][0]["dof"] for one in alike} == {18.0}


def test_a_calibration_stands_in_the_budgets_of_fit_and_run(tmp_path):
    """All of it in a thrust, nothing in a ratio, and who calibrated beside them."""
    known = {**CALIBRATION, "components": STATED, "calibrated_by": "Ada", "certificate": "DKD 7"}
    run = copied(tmp_path / "a", 1.0, calibration=known)
    budget = run_budget(Path(run))
    assert budget is not None
    line = next(one for one in budget.lines if one.name == "calibration cell: gravity")
    parts = np.array(line.contribution) / np.abs(budget.values)
    assert parts == pytest.approx([0.01, 0.01, 0.01, 0.0], abs=1e-6)
    assert budget.traceability == ("calibration cell: by Ada on 2026-01-31, certificate DKD 7",)
    fitted = run_recipe(replace(QUAD, data=(run,))).budget
    assert fitted is not None
    assert fitted.traceability == budget.traceability
    (line,) = (one for one in fitted.lines if one.name == "calibration cell: gravity")
    place = fitted.names.index("k")
    assert line.contribution[place] == pytest.approx(0.01 * fitted.values[place], rel=0.01)
