"""Where walkers begin: each ensemble around its own point, drawn wider than the answer."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchtool.core.errors import EstimationError
from benchtool.core.fit_result import FitResult
from benchtool.core.parameter import Parameter
from benchtool.fit.problem import Problem

Array = NDArray[np.float64]

CENTRE_SDS = 2.0
"""Ensembles start about this many standard deviations apart, so that agreement means something."""

TRIES = 60


def start_walkers(
    problem: Problem,
    near: FitResult | None,
    probability: Callable[[Array], Array],
    ensembles: int,
    walkers: int,
    rng: np.random.Generator,
) -> Array:
    """Return starts (ensembles * walkers, n_free) of finite probability.

    Args:
        problem: for bounds and present values.
        near: a least-squares result to start around, if there is one.
        probability: of walkers (w, n_free).
        ensembles: how many.
        walkers: of each.
        rng: draws the starts.
    """
    lower, upper = problem.parameters.bounds()
    middle = problem.parameters.pack() if near is None else near.values
    root = _root(problem, near)
    n = len(middle)
    centres = CENTRE_SDS * rng.standard_normal((ensembles, n))
    centre = np.repeat(centres, walkers, axis=0)
    starts = middle + (centre + rng.standard_normal(centre.shape)) @ root.T
    for attempt in range(TRIES):
        out = ((starts <= lower) | (starts >= upper)).any(axis=1)
        bad = out | ~np.isfinite(probability(starts))
        if not bad.any():
            return starts
        shrink = 0.85**attempt
        drawn = centre[bad] * shrink + rng.standard_normal((int(bad.sum()), n))
        starts[bad] = middle + shrink * drawn @ root.T
        if attempt > TRIES // 4:
            starts = np.clip(starts, *_inner(lower, upper, middle, np.diag(root @ root.T)))
    raise EstimationError(
        "no starting points of finite probability were found around the starting values; "
        "move the values away from their bounds"
    )


def _inner(lower: Array, upper: Array, middle: Array, variance: Array) -> tuple[Array, Array]:
    """Return bounds a little inside the given ones."""
    margin = 1e-3 * np.minimum(np.sqrt(variance), np.where(upper - lower > 0.0, upper - lower, 1.0))
    return lower + margin, upper - margin


def _root(problem: Problem, near: FitResult | None) -> Array:
    """Return a root (n, n) of the covariance to draw from; independent widths where it is not."""
    items = [problem.parameters[name] for name in problem.free_names]
    widths = np.array([_width(item) for item in items])
    if near is None:
        return np.diag(widths)
    covariance = near.covariance.copy()
    for i in range(len(items)):
        if not (np.isfinite(covariance[i, i]) and covariance[i, i] > 0.0):
            covariance[i, :] = covariance[:, i] = 0.0
            covariance[i, i] = widths[i] ** 2
    sd = np.minimum(np.sqrt(np.diag(covariance)), [_widest(item) for item in items])
    scale = 1.0 / np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance * np.outer(scale, scale))
    root: Array = sd[:, None] * vectors * np.sqrt(np.maximum(values, 1e-12))
    return root


def _width(item: Parameter) -> float:
    """Return a width to start with where the data give none."""
    if item.prior.kind == "normal":
        return item.prior.sd
    if np.isfinite(item.upper - item.lower):
        return 0.1 * (item.upper - item.lower)
    return 0.1 * abs(item.value) or item.tolerance or 0.1


def _widest(item: Parameter) -> float:
    """Return the largest width that leaves starts within finite bounds."""
    width = item.upper - item.lower
    return 0.25 * width if np.isfinite(width) else float("inf")
