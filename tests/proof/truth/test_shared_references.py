"""How often R of a single rotor holds the truth when many distances share few references."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binomtest

from benchtool.core.recording import Recording
from benchtool.core.rig_file import load_rig_by_name
from benchtool.data.columns import find_channel, word_to_code
from benchtool.data.run.ratios import ratios
from benchtool.fit.least_squares import fit_least_squares
from benchtool.fit.model_problem import problem_from_model
from benchtool.fit.problem import Problem
from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model

RIG = load_rig_by_name("pquad_single")
MODEL = Model.single(RIG, "single").with_free("R_m")
SPEED_RAD_S = 550.0
RELATIVE = 2e-3  # standard error of every thrust; two repeats, each with one reference


def problem(distances: int, rng: np.random.Generator) -> Problem:
    """Return the fit of ratios of a single rotor, each repeat's over its one reference."""
    z_over_R = np.tile([*np.geomspace(0.6, 3.0, distances), 1e3], 2)
    is_near = z_over_R < 100.0
    m = len(z_over_R)
    at = Conditions.build(
        RIG,
        speed_rad_s=np.full((1, m), SPEED_RAD_S),
        plate_z_m=z_over_R * RIG.propulsion.radius_m,
    )
    thrust = MODEL.thrust_N(at)
    table = {
        "kind": np.where(
            is_near, word_to_code("kind", "measure"), word_to_code("kind", "reference")
        ),
        "repeat": np.repeat([1.0, 2.0], m // 2),
        "pwm1_us": np.full(m, 1500.0),
        "thrust_N": thrust * (1.0 + RELATIVE * rng.standard_normal(m)),
        "thrust_se_N": thrust * RELATIVE,
    }
    points = Recording.from_columns(
        [(find_channel(name), np.asarray(column, float)) for name, column in table.items()]
    )
    found, rows = ratios(points, "equal_pwm"), np.flatnonzero(is_near)
    return problem_from_model(
        MODEL,
        at.select(rows),
        found.value[rows],
        found.standard_error[rows],
        basis="equal_pwm",
        error_sources=tuple(source.select(rows) for source in found.error_sources),
    )


def held(problems: list[Problem]) -> tuple[int, int]:
    """Return how many of the 68 and 95 % intervals of R hold the truth."""
    truth = MODEL.parameters["R_m"].value
    found = [fit_least_squares(one)["R_m"] for one in problems]
    return (
        sum(one.interval_68[0] <= truth <= one.interval_68[1] for one in found),
        sum(one.interval_95[0] <= truth <= one.interval_95[1] for one in found),
    )


@pytest.mark.parametrize("distances", [pytest.param(6, marks=pytest.mark.proof), 12])
def test_intervals_hold_with_the_covariance_and_not_without(distances):
    rng = np.random.default_rng([20261123, distances])
    problems = [problem(distances, rng) for _ in range(200)]
    for count, level in zip(held(problems), (0.6827, 0.95), strict=True):
        limits = binomtest(count, 200).proportion_ci(0.999, method="wilson")
        assert limits.low <= level <= limits.high, (count, level)
    alone = [replace(one, error_sources=()) for one in problems[:80]]
    at_68, at_95 = held(alone)
    assert at_68 < 0.6 * 80
    assert at_95 < 0.88 * 80
