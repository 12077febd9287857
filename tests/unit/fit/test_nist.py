"""Certified answers: NIST's nonlinear regression problems of lower and average difficulty."""

from __future__ import annotations

import numpy as np
import pytest

from benchtool.core.parameter import Parameter
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.problem import Problem, function_problem
from tests.unit.fit.nist import AVERAGE, LOWER, Certified, read

MODELS = {**LOWER, **AVERAGE}

# The residuals of Lanczos1 are of order 1e-13 on data of order 1: double precision leaves three
# digits of their sum, and so of everything proportional to it. Its values hold all six digits.
SD_DIGITS = {"Lanczos1": 2.5}


def nist_problem(certified: Certified, start: int) -> Problem:
    """State one problem from one of its two starting points, with the scatter unknown."""
    model = MODELS[certified.name]
    return function_problem(
        certified.name,
        {
            f"b{i}": Parameter(f"b{i}", "1", float(value), free=True)
            for i, value in enumerate(certified.starts[start], 1)
        },
        lambda b: model(b, certified.x),
        certified.y,
    )


def digits(found: float, certified: float) -> float:
    """Count the digits that agree, as NIST does (log relative error)."""
    return float(-np.log10(max(abs(found / certified - 1.0), 1e-16)))


@pytest.mark.parametrize("start", [0, 1], ids=["start 1", "start 2"])
@pytest.mark.parametrize("name", MODELS)
def test_certified_values_are_found_to_six_digits(name: str, start: int) -> None:
    certified = read(name)
    result = fit_least_squares(nist_problem(certified, start))
    assert result.outcome.status == "converged"
    assert result.facts["derivatives"] == "complex_step"
    for i, (value, sd) in enumerate(zip(certified.values, certified.sds, strict=True), 1):
        assert digits(result[f"b{i}"].value, value) >= 6.0, f"b{i}"
        assert digits(result[f"b{i}"].sd, sd) >= SD_DIGITS.get(name, 6.0), f"b{i}"
    assert digits(result.chi2, certified.residual_sum) >= SD_DIGITS.get(name, 8.0)
    assert digits(result["noise.scale"].value, certified.residual_sd) >= SD_DIGITS.get(name, 8.0)
    assert result.dof == certified.dof


def test_all_problems_of_both_difficulties_are_here() -> None:
    assert (len(LOWER), len(AVERAGE)) == (8, 11)
