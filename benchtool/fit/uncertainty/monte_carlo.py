"""A budget's check: draw every source from its distribution, refit, look at what came out.

JCGM 101:2008. Each draw adds an error to what the fitted model predicts and shifts the priors, and
the estimates are sought anew from there, with all the model's curvature.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from benchtool.core.array_type import Array
from benchtool.core.error_source import ErrorSource
from benchtool.fit.solve import row_jacobian
from benchtool.fit.uncertainty.budget import COVERAGE, MonteCarlo
from benchtool.fit.uncertainty.propagation import POINTS, Propagation

DRAWS = 2000  # ends of the 95 % interval then scatter by some 4 % of its half width
CLOSE = 1e-4  # part of a standard deviation below which a step of a refit no longer matters
STEPS = 20  # most Gauss-Newton steps of a refit; two or three are enough mostly


def monte_carlo(
    way: Propagation,
    outside: Sequence[ErrorSource] = (),
    beside: Sequence[tuple[ErrorSource, str]] = (),
    *,
    draws: int = DRAWS,
    seed: int = 1,
    progress: Callable[[str, int, int], None] = lambda what, done, expected: None,
) -> MonteCarlo:
    """Return what refits of drawn data found; `outside` and `beside` as `budget_of` takes them.

    Every error is that from the fit's own value.
    """
    rng, problem = np.random.default_rng(seed), way.problem
    m, shared = len(problem), problem.shared(way.noise)
    at = np.cumsum([0, *(one.columns.shape[1] for one in problem.error_sources)])
    errors = []
    for _ in range(draws):
        factor = 1.0  # of errors whose size was fitted: one for all (JCGM 101, 6.4.9)
        if problem.noise_name is not None:
            factor = float(np.sqrt(problem.dof / rng.chisquare(problem.dof)))
        error = factor * way.whitening.sigma * rng.standard_normal(m)
        scales = {POINTS: factor}
        for one, begin, end in zip(problem.error_sources, at[:-1], at[1:], strict=True):
            error += (factor if one.scaled else 1.0) * (shared[:, begin:end] @ drawn(one, rng))
        for one in outside:
            error += one.columns @ drawn(one, rng, scales)
        priors = [
            sum((one.columns @ drawn(one, rng, scales)).item() for one in parts)
            if parts
            else rng.standard_normal()
            for parts in problem.priors.parts
        ]
        errors.append(np.concatenate([way.whitening(error), priors]))
    shapes = np.empty((draws, len(way.shape)))
    for row, error in enumerate(errors):
        progress("Monte Carlo", row, draws)
        shapes[row] = _refit(way, error)
    found = way.quantities(shapes) - way.quantities(way.shape[None])
    for one, name in beside:
        found[:, way.names.index(name)] += [
            (one.columns @ drawn(one, rng)).item() for _ in range(draws)
        ]
    low, high = np.quantile(found, [0.5 - 0.5 * COVERAGE, 0.5 + 0.5 * COVERAGE], axis=0)
    return MonteCarlo(
        draws=draws,
        seed=seed,
        sd=tuple(found.std(axis=0, ddof=1).tolist()),
        low=tuple(low.tolist()),
        high=tuple(high.tolist()),
    )


def drawn(
    source: ErrorSource, rng: np.random.Generator, scales: dict[str, float] | None = None
) -> Array:
    """Return one draw (r,) of a source, of standard uncertainty 1 (JCGM 101, 6.4).

    Args:
        scales: how far off scatters are in this draw that several sources share; gains new ones.
    """
    r, scale = source.columns.shape[1], 1.0
    if source.distribution == "uniform":
        draw = rng.uniform(-np.sqrt(3.0), np.sqrt(3.0), r)
    elif source.distribution == "triangular":
        draw = rng.triangular(-np.sqrt(6.0), 0.0, np.sqrt(6.0), r)
    else:
        if np.isfinite(source.dof):
            scale = float(np.sqrt(source.dof / rng.chisquare(source.dof)))
            if source.scatter and scales is not None:
                scale = scales.setdefault(source.scatter, scale)
        draw = scale * rng.standard_normal(r)
    return np.asarray(draw, float)


def _refit(way: Propagation, error: Array) -> Array:
    """Return the shape (n_shape,) of least squares where whitened rows (m + q,) are off by this."""
    problem, whitening = way.problem, way.whitening
    lower, upper = problem.shape_bounds
    jacobian = row_jacobian(problem, way.derivatives)
    target = problem.rows(way.shape, whitening) + error
    shape = way.shape
    for _ in range(STEPS):
        rows, slopes = problem.rows(shape, whitening) - target, jacobian(shape, whitening)
        norms = np.linalg.norm(slopes, axis=0)
        step = np.linalg.lstsq(slopes / norms, -rows, rcond=None)[0] / norms
        moved: Array = np.clip(shape + step, lower, upper)
        if np.all(np.abs(moved - shape) <= CLOSE * way.sd):
            return moved
        shape = moved
    return shape
