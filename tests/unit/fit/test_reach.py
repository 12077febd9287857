"""What reaches a target uncertainty, against fits of what would then be measured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from benchtool.core.errors import UnknownChoice
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.problem import Problem
from benchtool.fit.recipe import Recipe
from benchtool.fit.run_recipe import FitOutput, run_recipe
from benchtool.fit.uncertainty.propagation import propagation
from benchtool.fit.uncertainty.reach import expected_sd, quantity_named, reach
from tests.unit.fit.cases import calibrated_line, decay_problem, line_problem
from tests.unit.fit.test_budget import shared

RUN = Path(__file__).parents[3] / "datasets" / "quad" / "run"


@pytest.mark.parametrize("make", [line_problem, decay_problem, calibrated_line])
def test_more_visits_do_what_a_fit_of_more_points_finds(make: Callable[[], Problem]) -> None:
    problem = make()
    result = fit_least_squares(problem)
    way = propagation(problem, result)
    assert way is not None
    # The same points four times have the same values, and intervals of four times the points.
    more = problem.subset(np.tile(np.arange(len(problem)), 4))
    again = fit_least_squares(more.at(result.values))
    for item in result.estimates:
        assert expected_sd(way, [], item.name) == pytest.approx(item.sd, rel=1e-6)
        if not len(problem.priors):  # a prior pulls the values elsewhere
            assert expected_sd(way, [], item.name, 4) == pytest.approx(
                again[item.name].sd, rel=1e-6
            )


def test_what_points_share_stays_and_what_each_stay_draws_falls() -> None:
    problem = line_problem()
    m = len(problem)
    stays = np.repeat(np.eye(5), m // 5, axis=0) * 0.3
    sources = (shared(m), shared(m, name="place", columns=stays))
    problem = replace(problem, error_sources=sources)
    way = propagation(problem, fit_least_squares(problem))
    assert way is not None
    rare = expected_sd(way, [], "a", 1e9)
    assert rare == pytest.approx(0.1, rel=1e-3)  # the common zero alone
    assert expected_sd(way, [], "a", 1e9, {"zero": 0.5}) == pytest.approx(0.05, rel=1e-3)
    outside = shared(m, 0.2, name="tare")
    both = expected_sd(way, [outside], "a", 1e9, {"zero": 1e-9})
    assert both == pytest.approx(0.2, rel=1e-3)


def test_a_quantity_may_be_named_without_its_unit() -> None:
    names = ("k", "R_m", "body_lift.K_b", "R_over_rotor_radius")
    asked = ("k", "R", "K_b", "R_m", "body_lift.K_b")
    found = [quantity_named(name, names) for name in asked]
    assert found == ["k", "R_m", "body_lift.K_b", "R_m", "body_lift.K_b"]
    with pytest.raises(UnknownChoice, match="quantity 'Q'"):
        quantity_named("Q", names)


@cache
def fitted() -> FitOutput:
    return run_recipe(Recipe(name="quad", data=(str(RUN),), model="quad_bench"))


def test_every_way_comes_to_what_it_says() -> None:
    """Each step is needed, and the way of several is no worse than the best alone."""
    output = fitted()
    assert output.budget is not None
    now = float(output.budget.combined[output.budget.names.index("R_m")])
    found = reach(output, "R_m", 0.5 * now, relative=False)
    assert (found.sd, found.wanted) == pytest.approx((now, 0.5 * now))
    assert found.together.sd <= now
    assert found.reached == (found.together.sd <= found.wanted)
    kinds = [(one.visits > 1, one.moved is not None, bool(one.known)) for one in found.single]
    assert all(sum(kind) == 1 for kind in kinds)
    assert (True, False, False) in kinds
    relative = reach(output, "R_m", 0.5 * now / found.value, relative=True)
    assert relative.wanted == pytest.approx(found.wanted)
