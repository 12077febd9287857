"""The log posterior of many walkers at once, with everything constant folded beforehand.

Priors: uniform within the bounds, or normal and cut off there; uniform in log(scale) for a free
`noise.scale` without a normal prior, so that its posterior gives the same Student's t intervals
as least squares.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchtool.fit.problem import NOISE_SCALE, Problem

Array = NDArray[np.float64]
LogProbability = Callable[[Array], Array]


def log_probability(problem: Problem) -> LogProbability:
    """Return the function walkers (w, n_free) -> log posterior (w,), up to a constant.

    It returns -inf outside the bounds and where the model has no finite value; it must be called
    with NumPy's warnings off.
    """
    predict, observed = problem.predict, problem.observed
    lower, upper = problem.parameters.bounds()
    shape_index = problem.shape_index
    all_shape = problem.noise_name is None
    likelihood = _likelihood(problem)
    prior = _prior(problem)
    m = len(problem)
    buffers: dict[int, Array] = {}

    def evaluate(walkers: Array) -> Array:
        w = walkers.shape[0]
        outside = ((walkers < lower) | (walkers > upper)).any(axis=1)
        any_outside = outside.any()
        inside = np.minimum(np.maximum(walkers, lower), upper) if any_outside else walkers
        columns = np.ascontiguousarray(inside.T)
        shape = columns if all_shape else columns[shape_index]
        rows = buffers.get(w)
        if rows is None:
            rows = buffers[w] = np.empty((w, m))
        np.subtract(predict(shape[:, :, None]), observed, out=rows)
        value = likelihood(rows, columns)
        if prior is not None:
            value += prior(shape, columns)
        if any_outside:
            value[outside] = -np.inf
        np.copyto(value, -np.inf, where=np.isnan(value))
        return value

    return evaluate


def _likelihood(problem: Problem) -> Callable[[Array, Array], Array]:
    """Return the function (residuals (w, m), free values (n_free, w)) -> log likelihood (w,)."""
    m = len(problem)
    if problem.noise_name is None or problem.noise_name == NOISE_SCALE:
        weight = 1.0 / problem.sigma(None if problem.noise_name is None else 1.0)
        added = [
            item.value for name, item in problem.parameters.items() if name.startswith("noise.sd")
        ]
        if problem.noise_name is None:

            def stated(rows: Array, columns: Array) -> Array:
                rows *= weight
                value: Array = np.einsum("wm,wm->w", rows, rows)
                value *= -0.5
                return value

            return stated
        if not any(added):
            position = problem.free_names.index(NOISE_SCALE)

            def scaled(rows: Array, columns: Array) -> Array:
                rows *= weight
                value: Array = np.einsum("wm,wm->w", rows, rows)
                scale = columns[position]
                value *= -0.5
                value /= scale * scale
                value -= m * np.log(scale)
                return value

            return scaled
    return _variances(problem)


def _variances(problem: Problem) -> Callable[[Array, Array], Array]:
    """Return the likelihood where the noise changes the weight of one point against another."""
    assert problem.noise_name is not None
    position = problem.free_names.index(problem.noise_name)
    is_scale = problem.noise_name == NOISE_SCALE
    alone = problem.sigma(1.0 if is_scale else 0.0) ** 2
    fixed = problem.sigma(0.0) ** 2 if is_scale else alone

    def varied(rows: Array, columns: Array) -> Array:
        squared = (columns[position] ** 2)[:, None]
        variance = fixed + squared * (alone - fixed) if is_scale else fixed + squared
        value: Array = -0.5 * (rows * rows / variance + np.log(variance)).sum(axis=1)
        return value

    return varied


def _prior(problem: Problem) -> Callable[[Array, Array], Array] | None:
    """Return the function (shape (n_shape, w), free (n_free, w)) -> log prior (w,), or None."""
    rows = problem.priors
    matrix, mean = rows.matrix, rows.mean[:, None]
    name = problem.noise_name
    position = -1 if name is None else problem.free_names.index(name)
    noise = None if name is None else problem.parameters[name].prior
    in_log = name == NOISE_SCALE and noise is not None and noise.kind == "uniform"
    normal = noise if noise is not None and noise.kind == "normal" else None
    if not len(rows) and not in_log and normal is None:
        return None

    def evaluate(shape: Array, columns: Array) -> Array:
        value = np.zeros(columns.shape[1])
        if len(rows):
            whitened = matrix @ (shape - mean)
            value -= 0.5 * np.einsum("qw,qw->w", whitened, whitened)
        if in_log:
            value -= np.log(columns[position])
        elif normal is not None:
            value -= 0.5 * ((columns[position] - normal.mean) / normal.sd) ** 2
        return value

    return evaluate
