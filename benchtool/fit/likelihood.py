"""How well one point of parameter space explains the data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchtool.fit.problem import NOISE_SCALE, Problem

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Quality:
    """Hold chi-square at the stated errors and the log likelihood at the fitted ones."""

    chi2: float
    log_likelihood: float


def split_values(problem: Problem, values: Array) -> tuple[Array, float | None]:
    """Return shape values (n_shape,) and noise of all free values (n_free,)."""
    if problem.noise_name is None:
        return values, None
    return values[problem.shape_index], float(values[problem.free_names.index(problem.noise_name)])


def stated_sigma(problem: Problem) -> Array:
    """Return the standard errors (m,) with a free noise parameter at its absent value."""
    if problem.noise_name is None:
        return problem.sigma()
    return problem.sigma(1.0 if problem.noise_name == NOISE_SCALE else 0.0)


def normal_log_density(residual: Array, sigma: Array) -> Array:
    """Return the log density (m,) of normal residuals."""
    density: Array = -0.5 * (residual / sigma) ** 2 - np.log(sigma) - 0.5 * np.log(2.0 * np.pi)
    return density


def residuals(problem: Problem, values: Array) -> Array:
    """Return observed less predicted (m,) at all free values (n_free,)."""
    shape, _ = split_values(problem, values)
    return problem.observed - problem.predicted(shape)


def fit_quality(problem: Problem, values: Array) -> Quality:
    """Return chi-square (priors included) and log likelihood (points only) at values (n_free,)."""
    shape, noise = split_values(problem, values)
    left = residuals(problem, values)
    rows = left / stated_sigma(problem)
    prior = problem.priors.matrix @ (shape - problem.priors.mean)
    return Quality(
        chi2=float(rows @ rows + prior @ prior),
        log_likelihood=float(normal_log_density(left, problem.sigma(noise)).sum()),
    )
