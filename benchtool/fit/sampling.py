"""How an ensemble samples: the log posterior of walkers, where they begin, how they move."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from emcee.moves import MHMove, Move
from emcee.state import State
from scipy.linalg import eigh

from benchtool.core.array_type import Array
from benchtool.core.errors import EstimationError
from benchtool.core.fit_result import FitResult
from benchtool.core.parameter import Parameter
from benchtool.fit.problem import NOISE_PLACE, NOISE_SCALE, Problem

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
        whiten = _whiten(problem)
        unscaled = [
            item.value for name, item in problem.parameters.items() if name.startswith("noise.sd")
        ] + [not source.scaled for source in problem.error_sources]
        if problem.noise_name is None:

            def stated(rows: Array, columns: Array) -> Array:
                rows = whiten(rows)
                value: Array = np.einsum("wm,wm->w", rows, rows)
                value *= -0.5
                return value

            return stated
        if not any(unscaled):
            position = problem.free_names.index(NOISE_SCALE)

            def scaled(rows: Array, columns: Array) -> Array:
                rows = whiten(rows)
                value: Array = np.einsum("wm,wm->w", rows, rows)
                scale = columns[position]
                value *= -0.5
                value /= scale * scale
                value -= m * np.log(scale)
                return value

            return scaled
    return _variances(problem)


def _whiten(problem: Problem) -> Callable[[Array], Array]:
    """Return the function residuals (w, m) -> whitened ones (w, m), at a free scale of 1."""
    whitening = problem.whitening(None if problem.noise_name is None else 1.0)
    if problem.error_sources:
        matrix = whitening(np.eye(len(problem))).T
        return lambda rows: rows @ matrix
    weight = 1.0 / whitening.sigma

    def divided(rows: Array) -> Array:
        rows *= weight
        return rows

    return divided


def _variances(problem: Problem) -> Callable[[Array, Array], Array]:
    """Return the likelihood where the noise changes the weight of one point against another.

    V is a fixed part and the squared noise times another. With shared errors both are made
    diagonal once, by the eigenvectors of the one in units of the other: every noise value is then
    a division.
    """
    assert problem.noise_name is not None
    position = problem.free_names.index(problem.noise_name)
    fixed, alone = problem.sigma(0.0) ** 2, problem.sigma(1.0) ** 2
    axes: Array | None = None
    if problem.error_sources:
        none, one = (
            np.diag(problem.sigma(noise) ** 2) + problem.shared(noise) @ problem.shared(noise).T
            for noise in (0.0, 1.0)
        )
        if problem.noise_name == NOISE_PLACE:  # of few draws: the other way about
            part, axes = eigh(one - none, none)
            fixed, alone = np.ones(len(part)), 1.0 + np.maximum(part, 0.0)
        else:
            fixed, axes = eigh(none, one - none)
            fixed = np.maximum(fixed, 0.0)
            alone = fixed + 1.0

    def varied(rows: Array, columns: Array) -> Array:
        rows = rows if axes is None else rows @ axes
        squared = (columns[position] ** 2)[:, None]
        variance = fixed + squared * (alone - fixed)
        value: Array = -0.5 * (rows * rows / variance + np.log(variance)).sum(axis=1)
        return value

    return varied


def _prior(problem: Problem) -> Callable[[Array, Array], Array] | None:
    """Return the function (shape (n_shape, w), free (n_free, w)) -> log prior (w,), or None."""
    rows = problem.priors
    matrix, mean, normal_rows = rows.matrix, rows.mean[:, None], np.isinf(rows.dof)
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
            value -= 0.5 * np.einsum("qw,qw->w", whitened[normal_rows], whitened[normal_rows])
            for some in rows.estimated:
                dof, squares = rows.dof[some[0]], np.sum(whitened[some] ** 2, axis=0)
                value -= 0.5 * (dof + len(some)) * np.log1p(squares / dof)
        if in_log:
            value -= np.log(columns[position])
        elif normal is not None:
            value -= 0.5 * ((columns[position] - normal.mean) / normal.sd) ** 2
        return value

    return evaluate


CENTRE_SDS = 2.0  # ensembles start so many sd apart, so that agreement means something
MAX_ATTEMPTS = 60


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
        near: a least-squares result to start around, if there is one.
        probability: of walkers (w, n_free).
    """
    lower, upper = problem.parameters.bounds()
    middle, root = centre_and_root(problem, near)
    n = len(middle)
    centres = CENTRE_SDS * rng.standard_normal((ensembles, n))
    centre = np.repeat(centres, walkers, axis=0)
    starts = middle + (centre + rng.standard_normal(centre.shape)) @ root.T
    for attempt in range(MAX_ATTEMPTS):
        out = ((starts <= lower) | (starts >= upper)).any(axis=1)
        bad = out | ~np.isfinite(probability(starts))
        if not bad.any():
            return starts
        shrink = 0.85**attempt
        drawn = centre[bad] * shrink + rng.standard_normal((int(bad.sum()), n))
        starts[bad] = middle + shrink * drawn @ root.T
        if attempt > MAX_ATTEMPTS // 4:
            width = np.where(upper - lower > 0.0, upper - lower, 1.0)
            margin = 1e-3 * np.minimum(np.sqrt(np.diag(root @ root.T)), width)
            starts = np.clip(starts, lower + margin, upper - margin)
    raise EstimationError(
        "no starting points of finite probability were found around the starting values; "
        "move the values away from their bounds"
    )


def centre_and_root(problem: Problem, near: FitResult | None) -> tuple[Array, Array]:
    """Return where to draw about (n,), and a root (n, n) of the covariance to draw with.

    They are those of a least-squares result; independent widths stand where it has none.
    """
    items = [problem.parameters[name] for name in problem.free_names]
    widths = np.array([_width(item) for item in items])
    if near is None:
        return problem.parameters.pack(), np.diag(widths)
    covariance = near.covariance.copy()
    for i in range(len(items)):
        if not (np.isfinite(covariance[i, i]) and covariance[i, i] > 0.0):
            covariance[i, :] = covariance[:, i] = 0.0
            covariance[i, i] = widths[i] ** 2
    # The largest width that leaves starts within finite bounds.
    within = np.array([item.upper - item.lower for item in items])
    sd = np.minimum(
        np.sqrt(np.diag(covariance)), np.where(np.isfinite(within), 0.25 * within, np.inf)
    )
    scale = 1.0 / np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance * np.outer(scale, scale))
    root: Array = sd[:, None] * vectors * np.sqrt(np.maximum(values, 1e-12))
    return near.values, root


def _width(item: Parameter) -> float:
    """Return a width to start with where the data give none."""
    if item.prior.kind == "normal":
        return item.prior.sd
    if np.isfinite(item.upper - item.lower):
        return 0.1 * (item.upper - item.lower)
    return 0.1 * abs(item.value) or item.tolerance or 0.1


DIFFERENCE = 2.38 / 2.0**0.5  # move length times root n (ter Braak, Stat. Comput. 16, 2006, p. 241)
JITTER = 0.2  # by how much, of its logarithm, that length varies; assumed

TAIL_DOF = 5.0  # of Student's t about least squares: wider than normal, to reach tails; assumed


class IslandDifference(Move):  # type: ignore[misc]
    """Move walkers of `islands` ensembles, stored one after the other, by differences of others."""

    def __init__(self, islands: int) -> None:
        self.islands = islands

    def propose(self, model: Any, state: Any) -> tuple[Any, Any]:
        """Return the next state and which walkers moved (islands * walkers,)."""
        random = model.random
        coords, log_prob = state.coords, state.log_prob
        total, n = coords.shape
        walkers = total // self.islands
        half = walkers // 2
        first = np.arange(self.islands)[:, None] * walkers
        order = random.rand(self.islands, walkers).argsort(axis=1) + first
        halves = (order[:, :half].ravel(), order[:, half:].ravel())
        size = (2, half * self.islands)
        one = random.randint(half, size=size)
        other = (one + random.randint(1, half, size=size)) % half
        begin = np.repeat(np.arange(self.islands) * half, half)
        length = DIFFERENCE / n**0.5 * np.exp(JITTER * random.standard_normal((*size, 1)))
        threshold = np.log(random.rand(*size))
        accepted = np.zeros(total, bool)
        for side in (0, 1):
            moved, others = halves[side], halves[1 - side]
            apart = coords[others[begin + one[side]]] - coords[others[begin + other[side]]]
            proposal = coords[moved] + length[side] * apart
            proposed = model.log_prob_fn(proposal)
            taken = proposed - log_prob[moved] > threshold[side]
            winners = moved[taken]
            coords[winners] = proposal[taken]
            log_prob[winners] = proposed[taken]
            accepted[winners] = True
        return State(coords, log_prob=log_prob), accepted


def proposal_around_least_squares(problem: Problem, near: FitResult | None) -> MHMove:
    """Return the move that draws walkers anew from Student's t about the least-squares answer.

    Where the posterior is about normal, such draws are nearly independent of where a walker was.
    """
    middle, root = centre_and_root(problem, near)
    n, inverse = len(middle), np.linalg.inv(root)

    def log_density(coords: Array) -> Array:
        z = (coords - middle) @ inverse.T
        out: Array = -0.5 * (TAIL_DOF + n) * np.log1p(np.einsum("wn,wn->w", z, z) / TAIL_DOF)
        return out

    def draw(coords: Array, random: Any) -> tuple[Array, Array]:
        scale = np.sqrt(TAIL_DOF / random.chisquare(TAIL_DOF, size=(len(coords), 1)))
        proposal = middle + (scale * random.standard_normal(coords.shape)) @ root.T
        return proposal, log_density(coords) - log_density(proposal)

    return MHMove(draw)
