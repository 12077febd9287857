"""Monte Carlo check of a budget: draw all sources from their distributions and refit.

JCGM 101:2008. Each draw adds errors to the prediction of the fitted model and to the priors; the
refit uses the full nonlinear model.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from benchtool.core.error_source import ErrorSource
from benchtool.core.units import Array
from benchtool.fit.solve import row_jacobian
from benchtool.fit.uncertainty.budget import COVERAGE, MonteCarlo
from benchtool.fit.uncertainty.propagation import POINTS, Propagation

DRAWS = 2000  # ends of the 95 % interval then scatter by some 4 % of its half width
CLOSE = 1e-4  # step of a converged refit, in standard deviations
MAX_STEPS = 20  # Gauss-Newton steps of a refit; two or three are typical


def monte_carlo(
    linear: Propagation,
    outside: Sequence[ErrorSource] = (),
    quantity_errors: Sequence[tuple[ErrorSource, str]] = (),
    *,
    draws: int = DRAWS,
    seed: int = 1,
    progress: Callable[[str, int, int], None] = lambda what, done, expected: None,
) -> MonteCarlo:
    """Return deviations of refits from the fit's values; sources as in `make_budget`."""
    rng, problem = np.random.default_rng(seed), linear.problem
    m, shared = len(problem), problem.shared(linear.noise)
    offsets = np.cumsum([0, *(source.columns.shape[1] for source in problem.error_sources)])
    errors = []
    for _ in range(draws):
        factor = 1.0  # common scale of errors with fitted noise (JCGM 101, 6.4.9)
        if problem.noise_name is not None:
            factor = float(np.sqrt(problem.dof / rng.chisquare(problem.dof)))
        error = factor * linear.whitening.sigma * rng.standard_normal(m)
        scales = {POINTS: factor}
        for source, first, end in zip(
            problem.error_sources, offsets[:-1], offsets[1:], strict=True
        ):
            scale = factor if source.scaled else 1.0
            error += scale * (shared[:, first:end] @ draw_source(source, rng))
        for source in outside:
            error += source.columns @ draw_source(source, rng, scales)
        priors = [
            sum((source.columns @ draw_source(source, rng, scales)).item() for source in parts)
            if parts
            else rng.standard_normal()
            for parts in problem.priors.parts
        ]
        errors.append(np.concatenate([linear.whitening(error), priors]))
    shapes = np.empty((draws, len(linear.shape)))
    for row, error in enumerate(errors):
        progress("Monte Carlo", row, draws)
        shapes[row] = _refit(linear, error)
    deviations = linear.quantities(shapes) - linear.quantities(linear.shape[None])
    for source, name in quantity_errors:
        deviations[:, linear.names.index(name)] += [
            (source.columns @ draw_source(source, rng)).item() for _ in range(draws)
        ]
    low, high = np.quantile(deviations, [0.5 - 0.5 * COVERAGE, 0.5 + 0.5 * COVERAGE], axis=0)
    return MonteCarlo(
        draws=draws,
        seed=seed,
        sd=tuple(deviations.std(axis=0, ddof=1).tolist()),
        low=tuple(low.tolist()),
        high=tuple(high.tolist()),
    )


def draw_source(
    source: ErrorSource, rng: np.random.Generator, scales: dict[str, float] | None = None
) -> Array:
    """Return one draw (r,) of a source, of standard uncertainty 1 (JCGM 101, 6.4).

    Args:
        scales: scale of each shared scatter in this draw; updated in place.
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


def _refit(linear: Propagation, error: Array) -> Array:
    """Return the least-squares shape (n_shape,) for errors of the whitened rows (m + q,)."""
    problem, whitening = linear.problem, linear.whitening
    lower, upper = problem.shape_bounds
    jacobian = row_jacobian(problem, linear.derivatives)
    target = problem.rows(linear.shape, whitening) + error
    shape = linear.shape
    for _ in range(MAX_STEPS):
        rows, slopes = problem.rows(shape, whitening) - target, jacobian(shape, whitening)
        norms = np.linalg.norm(slopes, axis=0)
        step = np.linalg.lstsq(slopes / norms, -rows, rcond=None)[0] / norms
        next_shape: Array = np.clip(shape + step, lower, upper)
        if np.all(np.abs(next_shape - shape) <= CLOSE * linear.sd):
            return next_shape
        shape = next_shape
    return shape
