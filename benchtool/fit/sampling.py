"""Ensemble sampling: log posterior of walkers, initial positions, moves."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from emcee.moves import MHMove, Move
from emcee.state import State
from scipy.linalg import eigh

from benchtool.core.errors import EstimationError
from benchtool.core.fit_result import FitResult
from benchtool.core.parameter import Parameter
from benchtool.core.units import Array
from benchtool.fit.problem import NOISE_PLACE, NOISE_SCALE, Problem


def log_probability(problem: Problem) -> Callable[[Array], Array]:
    """Return the function walkers (w, n_free) -> log posterior (w,), up to a constant.

    -inf outside the bounds and without a finite prediction. Call it with NumPy's warnings off.
    """
    predict, observed = problem.predict, problem.observed
    lower, upper = problem.parameters.bounds()
    likelihood, prior, m = _likelihood(problem), _prior(problem), len(problem)
    buffers: dict[int, Array] = {}

    def evaluate(walkers: Array) -> Array:
        w = walkers.shape[0]
        is_inside = (walkers >= lower) & (walkers <= upper)
        any_outside = not is_inside.all()
        inside = np.minimum(np.maximum(walkers, lower), upper) if any_outside else walkers
        columns = np.ascontiguousarray(inside.T)
        shape = columns if problem.noise_name is None else columns[problem.shape_index]
        rows = buffers.get(w)
        if rows is None:
            rows = buffers[w] = np.empty((w, m))
        np.subtract(predict(shape[:, :, None]), observed, out=rows)
        value = likelihood(rows, columns)
        value += prior(shape, columns)
        if any_outside:
            value[~is_inside.all(axis=1)] = -np.inf
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
        if problem.noise_name is None or not any(unscaled):
            position = None if problem.noise_name is None else problem.free_names.index(NOISE_SCALE)

            def one_factor(rows: Array, columns: Array) -> Array:
                rows = whiten(rows)
                value: Array = np.vecdot(rows, rows)
                value *= -0.5
                if position is not None:
                    scale = columns[position]
                    value /= scale * scale
                    value -= m * np.log(scale)
                return value

            return one_factor
    return _variances(problem)


def _whiten(problem: Problem) -> Callable[[Array], Array]:
    """Return the function residuals (w, m) -> whitened ones (w, m), at a free scale of 1."""
    whitening = problem.whitening(None if problem.noise_name is None else 1.0)
    if problem.error_sources:
        matrix = whitening(np.eye(len(problem))).T
        return lambda rows: rows @ matrix
    weight = 1.0 / whitening.sigma

    def divide(rows: Array) -> Array:
        rows *= weight
        return rows

    return divide


def _variances(problem: Problem) -> Callable[[Array, Array], Array]:
    """Return the likelihood if the noise changes the relative weights of points.

    V is a fixed part plus the squared noise times another part. With shared errors both are
    diagonalised once (generalised eigenvectors), so that each noise value needs a division only.
    """
    assert problem.noise_name is not None
    position = problem.free_names.index(problem.noise_name)
    fixed, with_noise = problem.sigma(0.0) ** 2, problem.sigma(1.0) ** 2
    eigenvectors: Array | None = None
    if problem.error_sources:
        without, with_unit_noise = (
            np.diag(problem.sigma(noise) ** 2) + problem.shared(noise) @ problem.shared(noise).T
            for noise in (0.0, 1.0)
        )
        if problem.noise_name == NOISE_PLACE:  # singular (few columns), so the roles are swapped
            eigenvalues, eigenvectors = eigh(with_unit_noise - without, without)
            fixed, with_noise = np.ones(len(eigenvalues)), 1.0 + np.maximum(eigenvalues, 0.0)
        else:
            fixed, eigenvectors = eigh(without, with_unit_noise - without)
            fixed = np.maximum(fixed, 0.0)
            with_noise = fixed + 1.0

    def variable_noise(rows: Array, columns: Array) -> Array:
        rows = rows if eigenvectors is None else rows @ eigenvectors
        squared = (columns[position] ** 2)[:, None]
        variance = fixed + squared * (with_noise - fixed)
        value: Array = -0.5 * (rows * rows / variance + np.log(variance)).sum(axis=1)
        return value

    return variable_noise


def _prior(problem: Problem) -> Callable[[Array, Array], Array]:
    """Return the function (shape (n_shape, w), free (n_free, w)) -> log prior (w,)."""
    rows = problem.priors
    matrix, mean, normal_rows = rows.matrix, rows.mean[:, None], np.isinf(rows.dof)
    name = problem.noise_name
    position = -1 if name is None else problem.free_names.index(name)
    noise = None if name is None else problem.parameters[name].prior
    in_log = name == NOISE_SCALE and noise is not None and noise.kind == "uniform"
    normal = noise if noise is not None and noise.kind == "normal" else None

    def evaluate(shape: Array, columns: Array) -> Array:
        value = np.zeros(shape.shape[1])
        if len(rows):
            whitened = matrix @ (shape - mean)
            value -= 0.5 * np.sum(whitened[normal_rows] ** 2, axis=0)
            for group in rows.estimated:
                dof, squares = rows.dof[group[0]], np.sum(whitened[group] ** 2, axis=0)
                value -= 0.5 * (dof + len(group)) * np.log1p(squares / dof)
        if in_log:
            value -= np.log(columns[position])
        elif normal is not None:
            value -= 0.5 * ((columns[position] - normal.mean) / normal.sd) ** 2
        return value

    return evaluate


CENTRE_SDS = 2.0  # sd of the ensembles' centres: starts are overdispersed, as R-hat needs
MAX_ATTEMPTS = 60


def start_walkers(
    problem: Problem,
    least_squares: FitResult | None,
    probability: Callable[[Array], Array],
    ensembles: int,
    walkers: int,
    rng: np.random.Generator,
) -> Array:
    """Return initial positions (ensembles * walkers, n_free) of finite probability.

    Args:
        least_squares: result to start around; None means the initial values.
        probability: log posterior of walkers (w, n_free).
    """
    lower, upper = problem.parameters.bounds()
    middle, root = centre_and_root(problem, least_squares)
    n = len(middle)
    centres = CENTRE_SDS * rng.standard_normal((ensembles, n))
    centre = np.repeat(centres, walkers, axis=0)
    starts = middle + (centre + rng.standard_normal(centre.shape)) @ root.T
    for attempt in range(MAX_ATTEMPTS):
        is_outside = ((starts <= lower) | (starts >= upper)).any(axis=1)
        rejected = is_outside | ~np.isfinite(probability(starts))
        if not rejected.any():
            return starts
        shrink = 0.85**attempt
        draws = centre[rejected] * shrink + rng.standard_normal((int(rejected.sum()), n))
        starts[rejected] = middle + shrink * draws @ root.T
        if attempt > MAX_ATTEMPTS // 4:
            width = np.where(upper - lower > 0.0, upper - lower, 1.0)
            margin = 1e-3 * np.minimum(np.sqrt(np.diag(root @ root.T)), width)
            starts = np.clip(starts, lower + margin, upper - margin)
    raise EstimationError(
        "no points of finite probability were found around the initial values; "
        "move these away from their bounds"
    )


def centre_and_root(problem: Problem, least_squares: FitResult | None) -> tuple[Array, Array]:
    """Return the centre (n,) and a root (n, n) of the covariance of initial positions.

    From a least-squares result; independent widths replace variances that it lacks.
    """
    parameters = [problem.parameters[name] for name in problem.free_names]
    widths = np.array([_width(parameter) for parameter in parameters])
    if least_squares is None:
        return problem.parameters.pack(), np.diag(widths)
    covariance = least_squares.covariance.copy()
    for i in range(len(parameters)):
        if not (np.isfinite(covariance[i, i]) and covariance[i, i] > 0.0):
            covariance[i, :] = covariance[:, i] = 0.0
            covariance[i, i] = widths[i] ** 2
    # Largest width that keeps initial positions within finite bounds.
    ranges = np.array([parameter.upper - parameter.lower for parameter in parameters])
    sd = np.minimum(
        np.sqrt(np.diag(covariance)), np.where(np.isfinite(ranges), 0.25 * ranges, np.inf)
    )
    scale = 1.0 / np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance * np.outer(scale, scale))
    root: Array = sd[:, None] * vectors * np.sqrt(np.maximum(values, 1e-12))
    return least_squares.values, root


def _width(parameter: Parameter) -> float:
    """Return the initial width of a parameter that the data do not determine."""
    if parameter.prior.kind == "normal":
        return parameter.prior.sd
    if np.isfinite(parameter.upper - parameter.lower):
        return 0.1 * (parameter.upper - parameter.lower)
    return 0.1 * abs(parameter.value) or parameter.tolerance or 0.1


DIFFERENCE = 2.38 / 2.0**0.5  # move length times root n (ter Braak, Stat. Comput. 16, 2006, p. 241)
JITTER = 0.2  # standard deviation of the logarithm of that length; assumed

TAIL_DOF = 5.0  # of the Student's t proposal: heavier tails than normal; assumed


class IslandDifference(Move):  # type: ignore[misc]
    """Differential evolution move within each of `islands` consecutive ensembles."""

    def __init__(self, islands: int) -> None:
        self.islands = islands

    def propose(self, model: Any, state: Any) -> tuple[Any, Any]:
        """Return the next state and the accepted walkers (islands * walkers,)."""
        random = model.random
        coords, log_prob = state.coords, state.log_prob
        total, n = coords.shape
        walkers = total // self.islands
        half = walkers // 2
        first = np.arange(self.islands)[:, None] * walkers
        order = random.rand(self.islands, walkers).argsort(axis=1) + first
        halves = (order[:, :half].ravel(), order[:, half:].ravel())
        size = (2, half * self.islands)
        pick_a = random.randint(half, size=size)
        pick_b = (pick_a + random.randint(1, half, size=size)) % half
        offset = np.repeat(np.arange(self.islands) * half, half)
        length = DIFFERENCE / n**0.5 * np.exp(JITTER * random.standard_normal((*size, 1)))
        threshold = np.log(random.rand(*size))
        accepted = np.zeros(total, bool)
        for side in (0, 1):
            active, others = halves[side], halves[1 - side]
            a, b = others[offset + pick_a[side]], others[offset + pick_b[side]]
            proposal = coords[active] + length[side] * (coords[a] - coords[b])
            proposed = model.log_prob_fn(proposal)
            is_accepted = proposed - log_prob[active] > threshold[side]
            accepted_walkers = active[is_accepted]
            coords[accepted_walkers] = proposal[is_accepted]
            log_prob[accepted_walkers] = proposed[is_accepted]
            accepted[accepted_walkers] = True
        return State(coords, log_prob=log_prob), accepted


def proposal_around_least_squares(problem: Problem, least_squares: FitResult | None) -> MHMove:
    """Return an independence sampler: Student's t around the least-squares estimate.

    For a nearly normal posterior its draws are almost independent of the walker's position.
    """
    middle, root = centre_and_root(problem, least_squares)
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
