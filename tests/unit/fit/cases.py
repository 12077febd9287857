"""Small problems with a known truth, for every estimator."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchtool.core.parameter import Parameter, Prior
from benchtool.core.rig_file import load_rig_by_name
from benchtool.fit.model_problem import function_problem, noise_parameter, problem_from_model
from benchtool.fit.problem import Problem
from benchtool.fit.uncertainty.load_cell import ScaleError, with_scale_errors
from benchtool.physics.conditions import Conditions
from benchtool.physics.model import Model

Array = NDArray[np.float64]
X = np.linspace(0.0, 1.0, 25)
QUAD_TRUTH = {"k": 1.0e-5, "R_m": 0.115, "body_lift.K_b": 1.7}
QUAD_SIGMA_N = 0.05


def free(
    name: str,
    value: float,
    lower: float = -np.inf,
    upper: float = np.inf,
    prior: Prior | None = None,
) -> Parameter:
    """Return a free parameter without a unit."""
    return Parameter(name, "1", value, lower=lower, upper=upper, free=True, prior=prior or Prior())


def line(v: Any) -> Any:
    """Return a straight line."""
    return v[0] + v[1] * X


def decay(v: Any) -> Any:
    """Return an exponential."""
    return v[0] * np.exp(-v[1] * X)


def noise(seed: int, m: int = len(X)) -> Array:
    """Return standard normal numbers."""
    return np.random.default_rng(seed).standard_normal(m)


def line_problem(seed: int = 1, sd: float = 0.2) -> Problem:
    """Straight line a = 1, b = 2, stated errors."""
    return function_problem(
        "line",
        {"a": free("a", 0.5), "b": free("b", 0.5)},
        line,
        1.0 + 2.0 * X + sd * noise(seed),
        np.full(len(X), sd),
    )


def scaled_line(seed: int = 1) -> Problem:
    """State the same line with errors known up to a factor (truth 3)."""
    problem = line_problem(seed)
    parameters = {**dict(problem.parameters), "noise.scale": noise_parameter()}
    observed = 1.0 + 2.0 * X + 3.0 * 0.2 * noise(seed)
    return function_problem("scaled line", parameters, line, observed, problem.standard_error)


def scattered_line(seed: int = 1) -> Problem:
    """State the same line with scatter of 0.3 beside stated errors of 0.2."""
    problem = line_problem(seed)
    parameters = {**dict(problem.parameters), "noise.sd": free("sd", 0.1, 0.0, 5.0)}
    observed = 1.0 + 2.0 * X + np.hypot(0.2, 0.3) * noise(seed)
    return function_problem("scattered line", parameters, line, observed, problem.standard_error)


def decay_problem(seed: int = 2) -> Problem:
    """Exponential 5 exp(-3 x), bounded, with a normal prior on the rate."""
    return function_problem(
        "decay",
        {
            "height": free("height", 2.0, 0.0, 50.0),
            "rate": free("rate", 1.0, 0.0, 20.0, Prior("normal", 3.2, 0.3)),
        },
        decay,
        5.0 * np.exp(-3.0 * X) + 0.1 * noise(seed),
        np.full(len(X), 0.1),
    )


def calibrated_line(seed: int = 3) -> Problem:
    """State a line read through a load cell with an uncertain calibration."""
    scale = {"name": "mass", "kind": "B", "unit": "1", "sd": 0.01, "relative_sd": 0.01, "dof": None}
    cell = {"id": "cell", "date": "2026-01-01", "relative_sd": 0.01, "components": [scale]}
    return with_scale_errors(line_problem(seed), [ScaleError(calibration=cell, rows=X < 2.0)])


def quad_model(*more: str) -> Model:
    """Return a quadrotor with body lift, k, R and K_b free."""
    model = Model.single(load_rig_by_name("pquad"), "quad").with_effect("neighbour_images")
    return model.with_effect("body_lift").with_free("k", "R_m", "body_lift.K_b", *more)


def quad_conditions(
    distances: tuple[float, ...] = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0), speeds: int = 5
) -> Conditions:
    """Return settled conditions at every distance (z/R) and speed."""
    rig = load_rig_by_name("pquad")
    z_m = np.repeat(np.array(distances) * 0.12, speeds)
    speed = np.tile(np.linspace(350.0, 700.0, speeds), len(distances))
    return Conditions.build(rig, speed_rad_s=np.tile(speed, (4, 1)), plate_z_m=z_m)


def quad_thrust(model: Model, conditions: Conditions) -> Array:
    """Return the true thrust (m,): N."""
    for name, value in QUAD_TRUTH.items():
        model = model.with_fixed(name, value)
    return np.asarray(model.thrust_N(conditions), float)


def quad_problem(seed: int = 5, *more: str) -> Problem:
    """State the fit of a simulated plate sweep."""
    model, conditions = quad_model(*more), quad_conditions()
    truth = quad_thrust(model, conditions)
    observed = truth + QUAD_SIGMA_N * noise(seed, len(truth))
    return problem_from_model(model, conditions, observed, np.full(len(truth), QUAD_SIGMA_N))


SMALL: dict[str, Callable[[], Problem]] = {
    "line": line_problem,
    "scaled line": scaled_line,
    "scattered line": scattered_line,
    "decay": decay_problem,
    "calibrated line": calibrated_line,
    "quadrotor": quad_problem,
}
